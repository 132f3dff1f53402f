"""Options for a bus: its bit rates, the rest bus and errors, the same for every program."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..bus_model.settings import LEVELS, LOAD_MAX, BusSettings, ClockSettings
from ..command_line import whole_number
from ..settings import COMMAND_LINE, SettingsError, load_settings, with_values

bit_rate = whole_number(10_000, 1_000_000)
"""Reads a bit rate that ISO 11898 allows; for CAN FD that of the arbitration phase [bit/s]."""
data_bit_rate = whole_number(10_000, 8_000_000)
"""Reads the bit rate of the data phase of CAN FD [bit/s]."""
_PARTS = 3
"""Of a burst, and of a stuck line."""
_NOT_HERE = {
    "receiver_bit_error_rate": "receiver_bit_error_rate: this program knows no single receiver",
    "clock": "clock: this program gives no node a clock; plant and controller have --clock",
}
"""What concerns single nodes, and why a program without an option for it refuses it in a file."""


def add_traffic_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options for the rest bus."""
    group = parser.add_argument_group("rest bus")
    group.add_argument(
        "--bus-settings", type=Path, metavar="BUS.toml", help="read these options from a file"
    )
    group.add_argument(
        "--rest-bus", action="append", default=[], metavar="FILE.dbc",
        help="also send the periodic messages of a database; repeatable",
    )  # fmt: skip
    group.add_argument(
        "--load", type=_number, metavar="SHARE",
        help=f"bus load of these or a built-in set, at most {LOAD_MAX:g}",
    )  # fmt: skip


def add_error_arguments(
    parser: argparse.ArgumentParser, nodes: str = "", *, has_clocks: bool = False
) -> None:
    """Add the options for errors.

    ``nodes``       how a node is named, for the help; empty where no node can be
    ``has_clocks``  whether the program can give nodes other clocks
    """
    group = parser.add_argument_group("errors on the bus")
    group.add_argument(
        "--bit-error-rate", type=_number, metavar="RATE",
        help="share of wrong bits: 0 to 0.01",
    )  # fmt: skip
    group.add_argument(
        "--burst", type=_burst, metavar="RATE:EVERY_S:FOR_S",
        help="a higher share in bursts: mean interval, mean length",
    )  # fmt: skip
    group.add_argument(
        "--stuck", type=_stuck, action="append", default=[], metavar="LEVEL:FROM_S:TO_S",
        help="hold the line dominant or recessive for a time; repeatable",
    )  # fmt: skip
    group.add_argument(
        "--needs-acknowledgement", action="store_true", default=None,
        help="a frame that no other node acknowledges is an error",
    )  # fmt: skip
    if nodes:
        group.add_argument(
            "--receiver-bit-error-rate", type=_at_one, action="append", default=[],
            metavar="NODE=RATE", help=f"share of wrong bits at {nodes} alone; repeatable",
        )  # fmt: skip
    if has_clocks:
        group.add_argument(
            "--clock", type=_clock, action="append", default=[], metavar="NODE=PPM[:PPM_S]",
            help=f"by which the timers of {nodes} run fast, and its change",
        )  # fmt: skip


def bus_settings(options: argparse.Namespace) -> BusSettings:
    """Return the settings of the file, with the options on top; raises SettingsError.

    One node is named only by programs that have an option for it.
    """
    settings = load_settings(BusSettings, None, options.bus_settings)
    for key in _NOT_HERE:
        if getattr(settings, key) and key not in options:
            raise SettingsError(f"{options.bus_settings}: {_NOT_HERE[key]}")
    given: dict[str, Any] = {key: getattr(options, key, None) for key in BusSettings.model_fields}
    given["bitrate_bit_s"] = getattr(options, "bitrate", None)
    given |= {key: dict(given[key]) for key in _NOT_HERE if given[key]}
    values = {key: value for key, value in given.items() if value not in (None, [])}
    return with_values(settings, values, COMMAND_LINE)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text[:60]!r} is not a number") from None


def _burst(text: str) -> Mapping[str, float]:
    keys = ("bit_error_rate", "interval_s", "length_s")
    return dict(zip(keys, map(_number, _parts(text)), strict=True))


def _at_one(text: str) -> tuple[str, float]:
    node, rate = _of_node(text, "RATE")
    return node, _number(rate)


def _stuck(text: str) -> Mapping[str, Any]:
    level, start, end = _parts(text)
    if level not in LEVELS:
        raise argparse.ArgumentTypeError(f"{text!r} begins with neither dominant nor recessive")
    return {"level": level, "start_s": _number(start), "end_s": _number(end)}


def _clock(text: str) -> tuple[str, Mapping[str, float]]:
    node, offsets = _of_node(text, "PPM")
    return node, _offsets(offsets)


def clock(text: str) -> ClockSettings:
    """Read PPM[:PPM_S], as a type of argparse."""
    try:
        return with_values(ClockSettings(), _offsets(text), "--clock")
    except SettingsError as error:
        raise argparse.ArgumentTypeError(str(error).removeprefix("--clock: ")) from None


def _offsets(text: str) -> Mapping[str, float]:
    ppm, _, drift = text.partition(":")
    return {"ppm": _number(ppm), "drift_ppm_s": _number(drift or "0")}


def _of_node(text: str, what: str) -> tuple[str, str]:
    node, equals, value = text.partition("=")
    if not (node and equals):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NODE={what}")
    return node, value


def _parts(text: str) -> Sequence[str]:
    parts = text.split(":")
    if len(parts) != _PARTS:
        raise argparse.ArgumentTypeError(f"{text!r} has not three parts with : between them")
    return parts
