"""``faults [SPEC]`` runs a campaign; ``faults inject`` is a program of its own."""

import importlib
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program that the first word names, the campaign by default; returns its status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    module = "program"
    if words[:1] == ["inject"]:
        module, words = "injection.program", words[1:]
    status: int = importlib.import_module(f"steer_by_wire.tools.faults.{module}").main(words)
    return status


if __name__ == "__main__":
    sys.exit(main())
