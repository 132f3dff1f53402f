"""Starts the one command: ``python -m steer_by_wire`` is ``steer-by-wire``."""

import sys

from steer_by_wire.command import main

if __name__ == "__main__":
    sys.exit(main())
