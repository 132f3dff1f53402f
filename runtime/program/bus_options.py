"""Options for a bus: its bit rates, the rest bus and errors, equal for every program."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..bus_model.settings import LOAD_MAX, BusSettings, ClockSettings
from ..command_line import whole_number
from ..settings import COMMAND_LINE, SettingsError, load_settings, with_values

bit_rate = whole_number(10_000, 1_000_000)
"""Reads a bit rate that ISO 11898 allows; for CAN FD that of the arbitration phase [bit/s]."""
data_bit_rate = whole_number(10_000, 8_000_000)
"""Reads the bit rate of the data phase of CAN FD [bit/s]."""
_BURST_PARTS = 3


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
        help=f"bus load of these messages or of a built-in set, at most {LOAD_MAX:g}",
    )  # fmt: skip


def add_error_arguments(parser: argparse.ArgumentParser, clocks_of: str = "") -> None:
    """Add the options for errors.

    ``clocks_of``  the nodes that the program can give other clocks, for the help
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
    if clocks_of:
        group.add_argument(
            "--clock", type=_clock, action="append", default=[], metavar="NODE=PPM[:PPM_S]",
            help=f"how much too fast the timers of {clocks_of} run, and its change per second",
        )  # fmt: skip


def bus_settings(options: argparse.Namespace) -> BusSettings:
    """Return the settings of the file, with the options on top; raises SettingsError.

    Clocks are refused by programs that have no option for them.
    """
    settings = load_settings(BusSettings, None, options.bus_settings)
    if settings.clock and "clock" not in options:
        raise SettingsError(
            f"{options.bus_settings}: clock: this program gives no node a clock; "
            "plant and controller have --clock"
        )
    given: dict[str, Any] = {key: getattr(options, key, None) for key in BusSettings.model_fields}
    given["bitrate_bit_s"] = getattr(options, "bitrate", None)
    given["clock"] = dict(given["clock"] or ())
    values = {key: value for key, value in given.items() if value not in (None, [], {})}
    return with_values(settings, values, COMMAND_LINE)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text[:60]!r} is not a number") from None


def _burst(text: str) -> Mapping[str, float]:
    parts = text.split(":")
    if len(parts) != _BURST_PARTS:
        raise argparse.ArgumentTypeError(f"{text!r} has not three parts with : between them")
    keys = ("bit_error_rate", "interval_s", "length_s")
    return dict(zip(keys, map(_number, parts), strict=True))


def _clock(text: str) -> tuple[str, Mapping[str, float]]:
    node, equals, offsets = text.partition("=")
    if not (node and equals):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NODE=PPM")
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
