"""Starts the program ``steer-by-wire hand-wheel``: ``hand_wheel.program``."""

import sys
from collections.abc import Sequence

from steer_by_wire.runtime.command_line import start_program

NAME = "steer-by-wire hand-wheel"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    return start_program("steer_by_wire.hand_wheel.program", arguments, NAME)


if __name__ == "__main__":
    sys.exit(main())
