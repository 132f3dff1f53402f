"""Starts program ``plant-emulator``: ``plant_emulator.program``."""

import sys
from collections.abc import Sequence

INTERRUPTED_STATUS = 130
INSTALLATION_STATUS = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    try:
        # Not above: Ctrl-C while the modules are read, half a second, is no reason for a traceback.
        from steer_by_wire.plant_emulator.program import main as run_program

        return run_program(arguments)
    except KeyboardInterrupt:
        return INTERRUPTED_STATUS
    except ImportError as error:  # a library is missing, or the DBC is damaged
        print(f"plant-emulator: error: {error}", file=sys.stderr)
        return INSTALLATION_STATUS


if __name__ == "__main__":
    sys.exit(main())
