"""Starts program ``emulated-can-bus``: ``runtime.emulated_bus.program``."""

import sys
from collections.abc import Sequence

NAME = "emulated-can-bus"
INTERRUPTED_STATUS = 130


def main(arguments: Sequence[str] | None = None, name: str = NAME) -> int:
    """Run the program, called ``name`` by who started it; returns its exit status."""
    try:
        # Not above: Ctrl-C while the modules are read is no reason for a traceback.
        from steer_by_wire.runtime.emulated_bus.program import main as run_program

        return run_program(arguments, name)
    except KeyboardInterrupt:
        return INTERRUPTED_STATUS


if __name__ == "__main__":
    sys.exit(main())
