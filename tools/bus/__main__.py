"""Starts the program ``steer-by-wire bus``: ``tools.bus.program``."""

import sys
from functools import partial

from steer_by_wire.runtime.command_line import start_program

main = partial(start_program, "steer_by_wire.tools.bus.program", name="steer-by-wire bus")

if __name__ == "__main__":
    sys.exit(main())
