"""Bound the response times of messages on a CAN bus.

steer-by-wire can response-times FILE.dbc...
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path

from rich.console import Console
from rich.table import Table

from steer_by_wire.closed_loop.reports.terminal import plain_table
from steer_by_wire.dbc.foreign_messages import read_message_set
from steer_by_wire.runtime.bus_model.response_times import (
    Sending,
    load,
    sending_of,
    wire_of,
    worst_response_ns,
)
from steer_by_wire.runtime.command_line import (
    add_json_argument,
    add_subcommand,
    command_parser,
    number,
    run_main,
    say,
)
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import EXTENDED, Frame
from steer_by_wire.runtime.node import NS_PER_MS
from steer_by_wire.runtime.program.bus_options import bit_rate, data_bit_rate
from steer_by_wire.runtime.program.report import show_or_write
from steer_by_wire.runtime.settings import SettingsError

NAME = "steer-by-wire can"
RESPONSE_TIMES = f"{NAME} response-times"
_DESCRIPTION = """Bound the response time of each message on a CAN bus.

    steer-by-wire can response-times FILE.dbc... [--bitrate BIT_S]

Several files share one bus. Messages without a cycle time are left out and named, unless
``--period NAME=MS`` gives one. ``steer-by-wire check`` says which delay a law tolerates. The exit
status is 0 whatever it finds.
"""
PERIOD_MS_MIN, PERIOD_MS_MAX = 0.1, 3_600_000


Response = tuple[Sending, Frame, int | None]
"""A message of the bus, a frame of it, and its longest response with any payload [ns]; None on an
overloaded bus."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the subcommand; returns its exit status."""
    example = f"{RESPONSE_TIMES} dbc/steer_by_wire.dbc --bitrate 125000"
    parser = command_parser(NAME, __doc__, example, "response-times ...")
    parsers = parser.add_subparsers(
        prog=NAME, dest="subcommand", required=True, metavar="SUBCOMMAND"
    )
    usage = "FILE... [options]"
    _add_arguments(add_subcommand(parsers, "response-times", _DESCRIPTION, example, usage))
    options = parser.parse_args(arguments)
    return run_main(RESPONSE_TIMES, partial(_response_times, options))


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--bitrate", type=bit_rate, default=500_000, metavar="BIT_S", help="default: %(default)s"
    )
    parser.add_argument(
        "--data-bitrate", type=data_bit_rate, default=2_000_000, metavar="BIT_S",
        help="bit rate of CAN FD's data phase (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="DBC, KCD, SYM, ARXML")
    parser.add_argument(
        "--jitter-ms", type=number(0.0, 60_000.0, "ms"), default=0.0, metavar="MS",
        help="release jitter of each message (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--period", action="append", default=[], metavar="NAME=MS",
        help="the cycle time of a message; may be repeated",
    )  # fmt: skip
    add_json_argument(parser)


def _response_times(options: argparse.Namespace) -> int:
    """Analyse a message set and print it; returns the exit status."""
    sent, left_out = _messages(options)
    for why, names in left_out.items():
        if names:
            say(RESPONSE_TIMES, f"left out, {why}: {', '.join(names)}", sys.stderr)
    if not sent:
        what = "no message has a cycle time; give some with --period NAME=MS"
        say(RESPONSE_TIMES, what, sys.stderr)
        return ExitStatus.SETTINGS
    wire, every = wire_of(options.bitrate), [sending for sending, _ in sent]
    responses = [(*one, worst_response_ns(one[0], every, wire)) for one in sent]
    busy = load(every, wire)
    console = Console(markup=False, highlight=False)
    console.width = max(console.width, 100)

    def show() -> None:
        console.print(_table(responses, options.bitrate))
        console.print(f"bus load: {100 * busy:.1f} %")

    rates = {"bitrate_bit_s": options.bitrate, "data_bitrate_bit_s": options.data_bitrate}
    record = {
        "bus": {**rates, "jitter_ms": options.jitter_ms},
        "messages": [
            {**sending._asdict(), "can_id": frame.can_id, "bound_ns": bound_ns}
            for sending, frame, bound_ns in responses
        ],
        "load": busy,
    }
    show_or_write(options.json, record, show)
    return ExitStatus.OK


def _messages(
    options: argparse.Namespace,
) -> tuple[list[tuple[Sending, Frame]], dict[str, list[str]]]:
    """Return the messages of the files by priority, each with a frame, and others' names by cause.

    Raises SettingsError for a file that cannot be read, and for two messages of one identifier.
    """
    listed = [message for file in options.files for message in read_message_set(file)]
    periods_ms = _periods_ms(options.period, {message.name for message in listed})
    sent, too_long, no_cycle = list[tuple[Sending, Frame]](), list[str](), list[str]()
    for message in listed:
        period_ms = periods_ms.get(message.name, message.cycle_ms)
        if not message.fits_a_frame:
            too_long.append(message.name)
        elif period_ms is None:
            no_cycle.append(message.name)
        else:
            frame = Frame(message.can_id, bytes(message.length), message.flags)
            rates = options.bitrate, options.data_bitrate
            sending = sending_of(message.name, frame, round(period_ms * NS_PER_MS), *rates)
            jitter_ns = round(options.jitter_ms * NS_PER_MS)
            sent.append((sending._replace(jitter_ns=jitter_ns), frame))
    sent.sort(key=lambda one: one[0].priority)
    for (one, frame), (other, _) in pairwise(sent):
        if one.priority == other.priority:
            raise SettingsError(
                f"{one.name} and {other.name} have the same identifier "
                f"0x{frame.can_id:X}: on one bus each message needs its own"
            )
    return sent, {"as they need several frames": too_long, "without a cycle time": no_cycle}


def _periods_ms(periods: Sequence[str], names: set[str]) -> dict[str, float]:
    given: dict[str, float] = {}
    for text in periods:
        name, _, value = text.partition("=")
        try:
            given[name] = float(value)
        except ValueError:
            given[name] = 0.0
        if name not in names or not PERIOD_MS_MIN <= given[name] <= PERIOD_MS_MAX:
            raise SettingsError(
                f"--period {text}: NAME=MS with a message of the files and {PERIOD_MS_MIN} to"
                f" {PERIOD_MS_MAX} ms"
            )
    return given


def _table(responses: Sequence[Response], bitrate_bit_s: int) -> Table:
    """Return one row a message, highest priority first."""
    title = f"response times [ms] at {bitrate_bit_s / 1000:g} kbit/s"
    numbers = ("bytes", "period", "frame", "bound", "deadline")
    table = plain_table(("message", "identifier"), numbers, title)
    table.caption = "bound: any payload and phases. deadline: the period."
    for sending, frame, bound_ns in responses:
        verdict = "no bound"
        if bound_ns is not None:
            verdict = "met" if bound_ns <= sending.period_ns else "MISSED"
        width = 8 if frame.flags & EXTENDED else 3
        table.add_row(
            sending.name, f"0x{frame.can_id:0{width}X}", str(len(frame.data)),
            f"{sending.period_ns / 1e6:g}", f"{sending.frame_ns / 1e6:.3f}",
            "-" if bound_ns is None else f"{bound_ns / 1e6:.3f}", verdict,
        )  # fmt: skip
    return table


if __name__ == "__main__":
    sys.exit(main())
