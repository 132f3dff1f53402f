"""The bus of a run in virtual time: its bit rate, other people's traffic, noise."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from ...command_line import number
from ...dbc.message_set import read_message_set
from ...pair.shared_bus import SharedBus, rest_of
from ...runtime.bus_errors import BusErrors
from ...runtime.bus_noise import BusNoise, NoiseRates, StuckLine
from ...runtime.drifting_clock import DriftingClock
from ...runtime.node import NS_PER_S, Node
from ...runtime.settings import SettingsError

LOAD_MAX = 1.5
_NODES = ("plant", "controller")
_LEVELS = ("dominant", "recessive")
_PARTS = 3
_rate = number(0.0, 0.01)
_ppm = number(-10_000.0, 10_000.0)


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
        "--bit-error-rate", type=_rate, metavar="RATE",
        help="share of the bits that are wrong: 0 to 0.01",
    )  # fmt: skip
    group.add_argument(
        "--burst", type=_burst, metavar="RATE:EVERY_S:FOR_S",
        help="another share in bursts (Gilbert and Elliott): mean interval, mean length",
    )  # fmt: skip
    group.add_argument(
        "--receiver-bit-error-rate", type=_at_one, action="append", default=[], metavar="NODE=RATE",
        help="share that plant or controller alone sees wrong; repeatable",
    )  # fmt: skip
    group.add_argument(
        "--stuck", type=_stuck, action="append", default=[], metavar="LEVEL:FROM_S:TO_S",
        help="a line that is dominant or recessive for a time; repeatable",
    )  # fmt: skip
    group.add_argument(
        "--clock", type=_clock, action="append", default=[], metavar="NODE=PPM[:PPM_S]",
        help="how much too fast plant's or controller's timers run, and its change",
    )  # fmt: skip


def shared_bus(options: argparse.Namespace, bitrate_bit_s: int, seed: int) -> SharedBus | None:
    """Return the bus with what the options put on it; None if that is nothing.

    Raises SettingsError for a database that cannot be used.
    """
    if options.load is not None and not options.rest_bus:
        raise SettingsError("--load needs --rest-bus FILE.dbc")
    errors = _errors(options, bitrate_bit_s, seed)
    if not options.rest_bus and errors is None:
        return None
    if options.ideal_wire or options.interface:
        raise SettingsError("other traffic and bus errors need a bus with a bit rate")
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


def _errors(options: argparse.Namespace, bitrate_bit_s: int, seed: int) -> BusErrors | None:
    given = (options.burst, options.receiver_bit_error_rate, options.stuck)
    if options.bit_error_rate is None and not any(given):
        return None
    rates = NoiseRates(options.bit_error_rate or 0.0, *(options.burst or ()))
    noise_of = {
        node: BusNoise(NoiseRates(rate), bitrate_bit_s, seed + 1 + node)
        for node, rate in options.receiver_bit_error_rate
    }
    stuck = sorted(options.stuck, key=lambda line: line.start_ns)
    return BusErrors(BusNoise(rates, bitrate_bit_s, seed), noise_of=noise_of, stuck=stuck)


def with_clocks(plant: Node, controller: Node, options: argparse.Namespace) -> tuple[Node, Node]:
    """Return both nodes by the clocks that the options give them."""
    nodes = [plant, controller]
    for index, ppm, drift_ppm_s in options.clock:
        nodes[index] = DriftingClock(nodes[index], ppm, drift_ppm_s)
    return nodes[0], nodes[1]


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
                f"{bus.errors.missed_by_one} missed by one receiver, "
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
    if options.burst is not None:
        words += ["--burst", ":".join(f"{part:g}" for part in options.burst)]
    for node, rate in options.receiver_bit_error_rate:
        words += ["--receiver-bit-error-rate", f"{_NODES[node]}={rate:g}"]
    for line in options.stuck:
        from_s, to_s = line.start_ns / NS_PER_S, line.end_ns / NS_PER_S
        words += ["--stuck", f"{_LEVELS[line.level]}:{from_s:g}:{to_s:g}"]
    for node, ppm, drift_ppm_s in options.clock:
        words += ["--clock", f"{_NODES[node]}={ppm:g}:{drift_ppm_s:g}"]
    return words


def _burst(text: str) -> tuple[float, float, float]:
    rate, every, length = _parts(text)
    return _rate(rate), number(0.001, 3600.0)(every), number(0.001, 60.0)(length)


def _at_one(text: str) -> tuple[int, float]:
    name, _, rate = text.partition("=")
    if name not in _NODES:
        raise argparse.ArgumentTypeError(f"{text!r} is not plant=RATE or controller=RATE")
    return _NODES.index(name), _rate(rate)


def _stuck(text: str) -> StuckLine:
    level, start, end = _parts(text)
    if level not in _LEVELS:
        raise argparse.ArgumentTypeError(f"{text!r} begins with neither dominant nor recessive")
    start_s = number(0.0, 86_400.0)(start)
    end_s = number(start_s, 86_400.0)(end)
    return StuckLine(_LEVELS.index(level), round(start_s * NS_PER_S), round(end_s * NS_PER_S))


def _clock(text: str) -> tuple[int, float, float]:
    name, _, offsets = text.partition("=")
    if name not in _NODES:
        raise argparse.ArgumentTypeError(f"{text!r} is not plant=PPM or controller=PPM")
    ppm, _, drift = offsets.partition(":")
    return _NODES.index(name), _ppm(ppm), _ppm(drift or "0")


def _parts(text: str) -> list[str]:
    parts = text.split(":")
    if len(parts) != _PARTS:
        raise argparse.ArgumentTypeError(f"{text!r} has not three parts with : between them")
    return parts
