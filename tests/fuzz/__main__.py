"""Fuzz one target, guided by coverage.

    python -m tests.fuzz controller --seconds 300
    python -m tests.fuzz settings --runs 100000 --seed 7 --corpus out/fuzz/settings
    python -m tests.fuzz plant --replay crash-0123abcd

Needs atheris (pip install '.[fuzz]'), except for --replay. Exit status: 0 if nothing was found; 1
if something was, with the input in the folder --out; 2 without atheris.
"""

import argparse
import importlib
import sys
import traceback
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from steer_by_wire.runtime.command_line import (
    add_out_argument,
    command_parser,
    installation,
    whole_number,
)

NAMES = (
    "authentication", "broker", "bus_client", "command_line", "controller",
    "log", "plant", "results", "settings", "specification", "trace", "waypoints",
)  # fmt: skip
"""Names in ``tests.fuzz.targets``, which must not be imported before atheris instruments it."""
NAME = "python -m tests.fuzz"
TIMEOUT_S = 60
"""An input that takes longer is a finding; the slowest of ours takes two seconds."""
INPUT_BYTES_MAX = 4096
MEMORY_MB_MAX = 2048
_REPLAYED_BYTES_MAX = 1 << 20


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status. Without ``--replay`` libFuzzer ends the process."""
    options = _parser().parse_args(arguments)
    if options.replay is not None:
        return _replay(options.target, options.replay)
    if find_spec("atheris") is None:
        print(
            f"{NAME}: error: needs atheris: {installation('atheris')};"
            " the suite runs the same targets with hypothesis",
            file=sys.stderr,
        )
        return 2
    _fuzz(options)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(NAME, __doc__, f"{NAME} controller --seconds 60", "TARGET [options]")
    parser.add_argument("target", choices=NAMES, metavar="TARGET", help=", ".join(NAMES))
    count = whole_number(0, 999_999_999)
    parser.add_argument("--runs", type=count, metavar="N", help="end after this many inputs")
    parser.add_argument("--seconds", type=count, metavar="S", help="end after this time")
    seed_help = "seed of libFuzzer (default: %(default)s)"
    parser.add_argument("--seed", type=count, default=1, metavar="N", help=seed_help)
    parser.add_argument(
        "--corpus", type=Path, metavar="DIR", help="inputs to start from; new ones are added"
    )
    add_out_argument(parser, "out/fuzz", "folder for inputs that break a promise")
    parser.add_argument("--replay", type=Path, metavar="FILE", help="run one input again")
    return parser


def _replay(target: str, file: Path) -> int:
    from tests.fuzz.targets import TARGETS

    try:
        with file.open("rb") as opened:
            data = opened.read(_REPLAYED_BYTES_MAX)  # a device may have no end
    except OSError as error:
        print(f"{NAME}: error: {file}: {error.strerror}", file=sys.stderr)
        return 2
    try:
        TARGETS[target](data)
    except Exception:  # whatever it finds
        traceback.print_exc()
        return 1
    print(f"{target}: {len(data)} bytes, no promise broken")
    return 0


def _fuzz(options: argparse.Namespace) -> None:
    """Hand over to libFuzzer, which ends the process."""
    atheris: Any = importlib.import_module("atheris")  # it has no types
    with atheris.instrument_imports(include=["steer_by_wire"]):
        targets = importlib.import_module("tests.fuzz.targets").TARGETS
    options.out.mkdir(parents=True, exist_ok=True)
    command = [
        sys.argv[0],
        f"-seed={options.seed}",
        f"-timeout={TIMEOUT_S}",
        f"-max_len={INPUT_BYTES_MAX}",
        "-len_control=0",  # a long input is a long run, from the start
        f"-rss_limit_mb={MEMORY_MB_MAX}",
        f"-artifact_prefix={options.out}/{options.target}-",
        "-print_final_stats=1",
    ]
    if options.runs is not None:
        command.append(f"-runs={options.runs}")
    if options.seconds is not None:
        command.append(f"-max_total_time={options.seconds}")
    if options.corpus is not None:
        options.corpus.mkdir(parents=True, exist_ok=True)
        command.append(str(options.corpus))
    atheris.Setup(command, targets[options.target])
    atheris.Fuzz()


if __name__ == "__main__":
    sys.exit(main())
