"""Starts the program ``steering-controller``: ``controller.program``."""

import sys
from collections.abc import Sequence

from steer_by_wire.runtime.command_line import start_program

NAME = "steering-controller"


def main(arguments: Sequence[str] | None = None, name: str = NAME) -> int:
    """Run the program under the name ``name``; returns its exit status."""
    return start_program("steer_by_wire.controller.program", arguments, name)


if __name__ == "__main__":
    sys.exit(main())
