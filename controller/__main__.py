"""Starts program ``steering-controller``: ``controller.program``."""

import sys
from collections.abc import Sequence

from steer_by_wire.command_line import missing_library

NAME = "steering-controller"
INTERRUPTED_STATUS = 130
INSTALLATION_STATUS = 2


def main(arguments: Sequence[str] | None = None, name: str = NAME) -> int:
    """Run the program, called ``name`` by who started it; returns its exit status."""
    try:
        # Not above: Ctrl-C while the modules are read, half a second, is no reason for a traceback.
        from steer_by_wire.controller.program import main as run_program

        return run_program(arguments, name)
    except KeyboardInterrupt:
        return INTERRUPTED_STATUS
    except ModuleNotFoundError as error:
        print(f"{name}: error: {missing_library(error)}", file=sys.stderr)
        return INSTALLATION_STATUS
    except ImportError as error:  # as for a damaged DBC
        print(f"{name}: error: {error}", file=sys.stderr)
        return INSTALLATION_STATUS


if __name__ == "__main__":
    sys.exit(main())
