"""``faults [SPEC]`` runs a campaign; ``inject`` and ``soak`` are programs of their own."""

import importlib
import sys
from collections.abc import Sequence

_PROGRAMS = {"inject": "injection.program", "soak": "live.soak"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program that the first word names, the campaign by default; returns its status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    module = _PROGRAMS.get(words[0]) if words else None
    if module is not None:
        words = words[1:]
    program = importlib.import_module(f"steer_by_wire.tools.faults.{module or 'program'}")
    status: int = program.main(words)
    return status


if __name__ == "__main__":
    sys.exit(main())
