"""Starts program ``emulated-can-bus``: ``runtime.emulated_bus.program``."""

import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    try:
        # Not above: Ctrl-C while the modules are read is no reason for a traceback.
        from steer_by_wire.runtime.emulated_bus.program import main as run_program

        return run_program(arguments)
    except KeyboardInterrupt:
        return 0  # as at any later time


if __name__ == "__main__":
    sys.exit(main())
