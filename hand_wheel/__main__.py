"""Starts the program ``steer-by-wire hand-wheel``: ``hand_wheel.program``."""

import sys
from functools import partial

from steer_by_wire.runtime.command_line import start_program

main = partial(start_program, "steer_by_wire.hand_wheel.program", name="steer-by-wire hand-wheel")

if __name__ == "__main__":
    sys.exit(main())
