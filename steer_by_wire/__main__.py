"""Starts the one command: ``python -m steer_by_wire`` is ``steer-by-wire``."""

import sys

try:
    from steer_by_wire.command import main
except KeyboardInterrupt:
    sys.exit(130)

if __name__ == "__main__":
    sys.exit(main())
