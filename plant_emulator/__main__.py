"""Starts the program ``steer-by-wire plant``: ``plant_emulator.command_line.program``."""

import sys
from collections.abc import Sequence

from steer_by_wire.runtime.command_line import start_program

NAME = "steer-by-wire plant"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    return start_program("steer_by_wire.plant_emulator.command_line.program", arguments, NAME)


if __name__ == "__main__":
    sys.exit(main())
