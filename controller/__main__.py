"""Starts the program ``steer-by-wire controller``: ``controller.command_line.program``."""

import sys
from functools import partial

from steer_by_wire.runtime.command_line import start_program

main = partial(
    start_program, "steer_by_wire.controller.command_line.program", name="steer-by-wire controller"
)

if __name__ == "__main__":
    sys.exit(main())
