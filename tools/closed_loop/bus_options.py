"""The bus of a run in virtual time: its bit rate, other people's traffic, noise."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from ...command_line import number
from ...dbc.message_set import read_message_set
from ...pair.shared_bus import SharedBus, rest_of
from ...runtime.bus_errors import BusErrors
from ...runtime.bus_noise import BusNoise, NoiseRates
from ...runtime.settings import SettingsError

LOAD_MAX = 1.5


def add_bus_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of what else is on the bus."""
    group = parser.add_argument_group("other traffic and noise, in virtual time")
    group.add_argument(
        "--rest-bus", type=Path, action="append", default=[], metavar="FILE.dbc",
        help="send the periodic messages of a database too; repeatable",
    )  # fmt: skip
    group.add_argument(
        "--load", type=number(0.0, LOAD_MAX, excludes_low=True), metavar="SHARE",
        help=f"of the bus that these messages take: above 0, to {LOAD_MAX:g} "
        "(default: their own cycle times)",
    )  # fmt: skip
    group.add_argument(
        "--bit-error-rate", type=number(0.0, 0.01), metavar="RATE",
        help="share of the bits that are wrong: 0 to 0.01",
    )  # fmt: skip


def shared_bus(options: argparse.Namespace, bitrate_bit_s: int, seed: int) -> SharedBus | None:
    """Return the bus with what the options put on it; None if that is nothing.

    Raises SettingsError for a database that cannot be used.
    """
    if options.load is not None and not options.rest_bus:
        raise SettingsError("--load needs --rest-bus FILE.dbc")
    if not options.rest_bus and options.bit_error_rate is None:
        return None
    if options.ideal_wire or options.interface:
        raise SettingsError("--rest-bus and --bit-error-rate need a bus with a bit rate")
    errors = None
    if options.bit_error_rate is not None:
        errors = BusErrors(BusNoise(NoiseRates(options.bit_error_rate), bitrate_bit_s, seed))
    messages = []
    if options.rest_bus:
        try:
            listed = [m for file in options.rest_bus for m in read_message_set(file)]
            messages = rest_of(listed, seed, bitrate_bit_s, options.load)
        except OSError as error:
            raise SettingsError(f"--rest-bus {error.filename}: {error.strerror}") from error
        except ValueError as error:
            raise SettingsError(f"--rest-bus: {error}") from error
    return SharedBus(bitrate_bit_s, messages, seed, errors)


def bus_lines(bus: SharedBus, duration_s: float) -> Sequence[tuple[str, str]]:
    """Return the lines of the summary on the bus."""
    load = bus.model.load
    lines = [
        (
            "bus",
            f"load {100 * load.busy_ns / (1e9 * duration_s):.1f} %, {load.frames} frames, "
            f"{load.refused} lost in full transmit buffers",
        )
    ]
    if bus.errors is not None:
        causes = ", ".join(f"{count} {cause}" for cause, count in bus.errors.causes.most_common())
        lines.append(
            (
                "bus errors",
                f"{causes or 'none'}; {bus.errors.received_twice} frames received twice, "
                f"{bus.errors.bus_offs} bus-off, {bus.model.lost_in_bus_off} lost in it",
            )
        )
    return lines


def bus_words(options: argparse.Namespace) -> list[str]:
    """Return the options as words of a command."""
    words = [word for file in options.rest_bus for word in ("--rest-bus", str(file))]
    if options.load is not None:
        words += ["--load", f"{options.load:g}"]
    if options.bit_error_rate is not None:
        words += ["--bit-error-rate", f"{options.bit_error_rate:g}"]
    return words
