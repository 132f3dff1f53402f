"""Puts the single file of with-vcan into its package; ``pyproject.toml`` has the rest."""

import sys
from pathlib import Path

from setuptools import setup

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))

from steer_by_wire.tools.vcan.single_file import write_single_file  # noqa: E402 the path comes first

write_single_file(HERE / "with_vcan" / "with-vcan.pyz")
setup()
