"""Options for a bus: its bit rate, the rest bus and bit errors, equal for every program."""

import argparse
from pathlib import Path
from typing import Any

from ..bus_model.settings import LOAD_MAX, BusSettings
from ..command_line import whole_number
from ..settings import COMMAND_LINE, SettingsError, load_settings, with_values

bit_rate = whole_number(10_000, 1_000_000)
"""Reads a bit rate that ISO 11898 allows; for CAN FD that of the arbitration phase [bit/s]."""
data_bit_rate = whole_number(10_000, 8_000_000)
"""Reads the bit rate of the data phase of CAN FD [bit/s]."""


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


def add_error_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option for bit errors, of programs that run in virtual time."""
    parser.add_argument(
        "--bit-error-rate", type=_number, metavar="RATE",
        help="share of wrong bits: 0 to 0.01",
    )  # fmt: skip


def bus_settings(options: argparse.Namespace) -> BusSettings:
    """Return the settings of the file, with the options on top; raises SettingsError.

    Bit errors are refused by programs that have no option for them.
    """
    settings = load_settings(BusSettings, None, options.bus_settings)
    if settings.has_errors and "bit_error_rate" not in options:
        raise SettingsError(
            f"{options.bus_settings}: bit_error_rate: only runs in virtual time have bit errors"
        )
    given: dict[str, Any] = {key: getattr(options, key, None) for key in BusSettings.model_fields}
    given["bitrate_bit_s"] = getattr(options, "bitrate", None)
    values = {key: value for key, value in given.items() if value not in (None, [])}
    return with_values(settings, values, COMMAND_LINE)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text[:60]!r} is not a number") from None
