"""Run a command with a real vcan0: the host's own, a network namespace's, or User Mode Linux's.

    with-vcan [--backend host|namespace|uml|auto] [--netem "delay 40ms"] COMMAND...

Exit status: the command's; 2 for wrong arguments, 3 where there is no way to a vcan0, 124 when the
time is up, 126 and 127 for a command that cannot be run or is not found.
"""

import argparse
import math
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from .backend_choice import BACKENDS, Backend, choose
from .request import BackendError, Request, interface_names, netem_of

NAME = "with-vcan"
UNAVAILABLE_STATUS = 3
UNWRITABLE_STATUS = 4
STDERR = 2
SECONDS_MAX, MEBIBYTES = 1e9, (128, 65536)
"""Of ``--timeout`` and ``--memory``."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    options = _parse(arguments)
    if options.write_single_file is not None:
        return _write_single_file(options.write_single_file)
    request = Request(tuple(options.command), options.interfaces, options.netem, options.memory)
    try:
        backend = choose(options.backend, request)
        if options.which:
            print(backend.name)
            return 0
        return _run(backend, request, options.timeout)
    except BackendError as error:
        print(f"{NAME}: error: {error}", file=sys.stderr)
        return UNAVAILABLE_STATUS
    except KeyboardInterrupt:
        return 130


def _write_single_file(path: Path) -> int:
    from .single_file import write_single_file

    try:
        write_single_file(path)
    except OSError as error:
        print(f"{NAME}: error: {path}: {error.strerror}", file=sys.stderr)
        return UNWRITABLE_STATUS
    return 0


def _run(backend: Backend, request: Request, timeout_s: float | None) -> int:
    from .supervision import TIMEOUT_STATUS, block_signals

    # Otherwise one of our pipes could get the number of a closed standard stream.
    while os.open(os.devnull, os.O_RDWR) <= STDERR:
        pass
    block_signals()
    status = backend.run(request, timeout_s)
    if status == TIMEOUT_STATUS and timeout_s is not None:
        print(f"{NAME}: error: ended after {timeout_s:g} s", file=sys.stderr)
    return status


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog=NAME,
        usage="%(prog)s [options] COMMAND...",
        description=(__doc__ or "").partition("\n")[0],
        epilog=f"example:\n  {NAME} ip -details link show vcan0",
        formatter_class=partial(argparse.RawDescriptionHelpFormatter, max_help_position=30),
        allow_abbrev=False,
    )
    parser.add_argument(
        "--backend",
        choices=("auto", *BACKENDS),
        default="auto",
        help="default: auto, the first one that works here",
    )
    parser.add_argument(
        "--netem",
        action="append",
        default=[],
        metavar="[NAME:]PARAMETERS",
        help='latency in the kernel, such as "delay 40ms 10ms loss 1%%" (tc-netem(8)), of all '
        "interfaces or one, in both directions",
    )
    parser.add_argument(
        "--timeout", type=_seconds, metavar="SECONDS", help="end with status 124 after this time"
    )
    parser.add_argument(
        "--interfaces",
        type=_interfaces,
        default=("vcan0",),
        metavar="N|NAMES",
        help="a number (vcan0, vcan1, ...) or comma-separated names; default: vcan0",
    )
    parser.add_argument(
        "--memory",
        type=_mebibytes,
        default=1024,
        metavar="MIB",
        help="memory of User Mode Linux",
    )
    parser.add_argument(
        "--which", action="store_true", help="only print which backend would be used"
    )
    parser.add_argument(
        "--write-single-file", type=Path, metavar="FILE", help="write this program as one file"
    )
    parser.add_argument(
        "command", nargs=argparse.REMAINDER, metavar="COMMAND...", help="command with its arguments"
    )
    options = parser.parse_args(arguments)
    if options.command[:1] == ["--"]:
        del options.command[0]
    try:
        options.netem = netem_of(options.netem, options.interfaces)
    except ValueError as error:
        parser.error(f"argument --netem: {error}")
    if not (options.command or options.which or options.write_single_file):
        parser.error("a command is missing")
    return options


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value <= SECONDS_MAX:
        raise argparse.ArgumentTypeError(
            f"allowed is above 0 to {SECONDS_MAX:g} s, not {text[:60]!r}"
        )
    return value


def _mebibytes(text: str) -> int:
    low, high = MEBIBYTES
    is_whole = text.isascii() and text.isdecimal() and len(text) <= len(str(high))
    if not (is_whole and low <= int(text) <= high):
        raise argparse.ArgumentTypeError(f"allowed is {low} to {high}, not {text[:60]!r}")
    return int(text)


def _interfaces(text: str) -> tuple[str, ...]:
    try:
        return interface_names(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


if __name__ == "__main__":
    sys.exit(main())
