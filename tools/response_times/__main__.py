"""Bounds the response time of each message on a CAN bus, beside the worst case simulated.

    steer-by-wire response-times FILE.dbc... [--bitrate BIT_S] [--error-interval-ms MS]

Several files share one bus. Messages without a cycle time are left out and named, unless
``--period NAME=MS`` gives one. Where the set has this project's steering messages, the delay that
the bus adds to them stands beside what each law tolerates. Exit status 0 whatever it finds.
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rich.console import Console

from steer_by_wire.command_line import command_parser, number, whole_number
from steer_by_wire.runtime.option_types import bit_rate, data_bit_rate, output_file
from steer_by_wire.runtime.program import ExitStatus, run_main, say
from steer_by_wire.runtime.report import write_json
from steer_by_wire.tools.response_times.message_set import (
    BusSettings,
    read_messages,
)
from steer_by_wire.tools.response_times.presentation import record_of, response_table, steering_text
from steer_by_wire.tools.response_times.responses import respond
from steer_by_wire.tools.response_times.steering import DEFAULT_PRESETS, steering_of

NAME = "steer-by-wire response-times"


def main(arguments: Sequence[str] | None = None) -> int:
    """Analyse a message set and print it; returns the exit status."""
    return run_main(NAME, partial(_run, _parse(arguments)))


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = command_parser(
        NAME, __doc__, f"{NAME} dbc/steer_by_wire.dbc --bitrate 125000", "FILE... [options]"
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="DBC, KCD, SYM, ARXML")
    parser.add_argument(
        "--bitrate", type=bit_rate, default=500_000, metavar="BIT_S", help="default: %(default)s"
    )
    parser.add_argument(
        "--data-bitrate", type=data_bit_rate, default=2_000_000, metavar="BIT_S",
        help="of CAN FD's data phase (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--jitter-ms", type=number(0.0, 60_000.0, "ms"), default=0.0, metavar="MS",
        help="how late each release can be (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--error-interval-ms", type=number(0.0, 60_000.0, "ms"), metavar="MS",
        help="least time between two bus errors (default: no errors)",
    )  # fmt: skip
    parser.add_argument(
        "--errors-at-once", type=whole_number(0, 100), default=0, metavar="N",
        help="so many more errors at the worst instants, as in a burst",
    )  # fmt: skip
    parser.add_argument(
        "--bit-error-rate", type=number(0.0, 0.01), metavar="RATE",
        help="errors at random: the chance that a release misses its deadline",
    )  # fmt: skip
    parser.add_argument(
        "--period", action="append", default=[], metavar="NAME=MS",
        help="the cycle time of a message; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--preset", action="append", metavar="NAME",
        help=f"controllers to compare with (default: {', '.join(DEFAULT_PRESETS)})",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=whole_number(0, 2**63 - 1), default=1, metavar="N",
        help="of the random phases (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--json", type=output_file, metavar="FILE", help="write the figures too")
    return parser.parse_args(arguments)


def _run(options: argparse.Namespace) -> int:
    errors = options.error_interval_ms, options.errors_at_once, options.bit_error_rate
    bus = BusSettings(options.bitrate, options.data_bitrate, options.jitter_ms, *errors)
    messages, segmented, left_out = read_messages(options.files, options.period, bus)
    if segmented:
        say(NAME, f"carried by TP.CM and TP.DT: {', '.join(segmented)}", sys.stderr)
    if left_out:
        say(NAME, f"left out, without a cycle time: {', '.join(left_out)}", sys.stderr)
    if not messages:
        say(NAME, "no message has a cycle time; give some with --period NAME=MS", sys.stderr)
        return ExitStatus.SETTINGS
    steering = steering_of(messages, bus, options.preset or DEFAULT_PRESETS)
    responses = respond(messages, bus, options.seed)
    console = Console(markup=False, highlight=False)
    console.width = max(console.width, 100)
    console.print(response_table(responses, bus))
    if steering is not None:
        console.print(steering_text(steering), soft_wrap=True)
    if options.json is not None:
        write_json(options.json, record_of(responses, bus, steering, options.seed))
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
