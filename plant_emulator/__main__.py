"""Starts the program ``steer-by-wire plant``: ``plant_emulator.command_line.program``."""

import sys
from functools import partial

from steer_by_wire.runtime.command_line import start_program

main = partial(
    start_program, "steer_by_wire.plant_emulator.command_line.program", name="steer-by-wire plant"
)

if __name__ == "__main__":
    sys.exit(main())
