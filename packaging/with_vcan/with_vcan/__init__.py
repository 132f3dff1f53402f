"""The command with-vcan, which is the single file beside this one."""

import os
import sys
from pathlib import Path
from typing import NoReturn


def main() -> NoReturn:
    """Become it."""
    file = str(Path(__file__).with_name("with-vcan.pyz"))
    os.execv(sys.executable, [sys.executable, file, *sys.argv[1:]])  # noqa: S606 as given
