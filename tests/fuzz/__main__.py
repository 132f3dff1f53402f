"""Fuzz one target, guided by coverage, with the options of libFuzzer.

    python -m tests.fuzz controller -max_total_time=300
    python -m tests.fuzz settings -runs=100000 -seed=7 out/fuzz/settings
    python -m tests.fuzz plant --replay out/fuzz/plant-crash-0123abcd

Needs atheris (pip install '.[fuzz]'), except for --replay, which runs one input again. What breaks
a promise is left in out/fuzz.
"""

import importlib
import sys
from pathlib import Path
from typing import Any

OUT = Path("out") / "fuzz"
LIMITS = ("-timeout=60", "-max_len=4096", "-rss_limit_mb=2048")
"""The slowest of our inputs takes two seconds."""
LONG_FROM_THE_START = "-len_control=0"
"""A long input is a long run."""


def main(target: str, *options: str) -> None:
    """Replay one input, or hand over to libFuzzer, which ends the process."""
    if options[:1] == ("--replay",):
        importlib.import_module("tests.fuzz.targets").TARGETS[target](Path(options[1]).read_bytes())
        return
    try:
        atheris: Any = importlib.import_module("atheris")  # it has no types
    except ModuleNotFoundError:
        sys.exit("fuzzing needs atheris: pip install '.[fuzz]'")
    with atheris.instrument_imports(include=["steer_by_wire"]):
        targets = importlib.import_module("tests.fuzz.targets").TARGETS
    OUT.mkdir(parents=True, exist_ok=True)
    found = f"-artifact_prefix={OUT}/{target}-"
    atheris.Setup([sys.argv[0], *LIMITS, LONG_FROM_THE_START, found, *options], targets[target])
    atheris.Fuzz()


if __name__ == "__main__":
    main(*sys.argv[1:])
