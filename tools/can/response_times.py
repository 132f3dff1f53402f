"""Bound the response time of each message on a CAN bus.

    steer-by-wire can response-times FILE.dbc... [--bitrate BIT_S]

Several files share one bus. Messages without a cycle time are left out and named, unless
``--period NAME=MS`` gives one. ``steer-by-wire check`` says which delay a law tolerates. The exit
status is 0 whatever it finds.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from steer_by_wire.closed_loop.reports.terminal import plain_table
from steer_by_wire.runtime.command_line import add_json_argument, number, say
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.program.bus_options import bit_rate, data_bit_rate
from steer_by_wire.runtime.program.report import show_or_write
from steer_by_wire.tools.can.message_set import (
    BusSettings,
    Response,
    load_of,
    read_messages,
    respond,
)

NAME = "steer-by-wire can response-times"
EXAMPLE = f"{NAME} dbc/steer_by_wire.dbc --bitrate 125000"
USAGE = "FILE... [options]"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
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


def run(options: argparse.Namespace) -> int:
    """Analyse a message set and print it; returns the exit status."""
    bus = BusSettings(options.bitrate, options.data_bitrate, options.jitter_ms)
    messages, too_long, left_out = read_messages(options.files, options.period, bus)
    if too_long:
        say(NAME, f"left out, as they need several frames: {', '.join(too_long)}", sys.stderr)
    if left_out:
        say(NAME, f"left out, without a cycle time: {', '.join(left_out)}", sys.stderr)
    if not messages:
        say(NAME, "no message has a cycle time; give some with --period NAME=MS", sys.stderr)
        return ExitStatus.SETTINGS
    responses, load = respond(messages, bus), load_of(messages, bus)
    console = Console(markup=False, highlight=False)
    console.width = max(console.width, 100)

    def show() -> None:
        console.print(response_table(responses, bus))
        console.print(f"bus load: {100 * load:.1f} %")

    show_or_write(options.json, record_of(responses, bus, load), show)
    return ExitStatus.OK


def response_table(responses: Sequence[Response], bus: BusSettings) -> Table:
    """Return one row a message, highest priority first."""
    title = f"response times [ms] at {bus.bitrate_bit_s / 1000:g} kbit/s"
    numbers = ("bytes", "period", "frame", "bound", "deadline")
    table = plain_table(("message", "identifier"), numbers, title)
    table.caption = "bound: any payload and phases. deadline: the period."
    for response in responses:
        bound = response.message.bound
        frame = response.message.frame
        width = 8 if frame.flags & 1 else 3
        table.add_row(
            bound.name, f"0x{frame.can_id:0{width}X}", str(len(frame.data)),
            f"{bound.period_ns / 1e6:g}", _ms(bound.frame_ns), _ms(response.bound_ns),
            _verdict(response),
        )  # fmt: skip
    return table


def record_of(responses: Sequence[Response], bus: BusSettings, load: float) -> dict[str, Any]:
    """Return everything, for another program; times in nanoseconds."""
    return {
        "bus": bus._asdict(),
        "messages": [
            {
                **response.message.bound._asdict(),
                "can_id": response.message.frame.can_id,
                "bound_ns": response.bound_ns,
            }
            for response in responses
        ],
        "load": load,
    }


def _verdict(response: Response) -> str:
    if response.is_in_time is None:
        return "no bound"
    return "met" if response.is_in_time else "MISSED"


def _ms(time_ns: int | None) -> str:
    return "-" if time_ns is None else f"{time_ns / 1e6:.3f}"
