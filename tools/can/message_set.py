"""The messages of the given files as traffic of one bus, and the bound of each."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ...dbc.foreign_messages import ListedMessage, read_message_set
from ...runtime.frame import EXTENDED, Frame
from ...runtime.frame.arbitration import arbitration_field
from ...runtime.frame.length_with_stuff_bits import FrameBits, most_frame_bits
from ...runtime.node import NS_PER_MS
from ...runtime.settings import SettingsError
from .response_time_bounds import Traffic, load, wire_of, worst_response_ns


class BusSettings(NamedTuple):
    """The bus, as given by the options."""

    bitrate_bit_s: int
    data_bitrate_bit_s: int
    jitter_ms: float

    def duration_ns(self, bits: FrameBits) -> int:
        """Return how long so many bits take, rounded up [ns]."""
        nominal, data = self.bitrate_bit_s, self.data_bitrate_bit_s
        return -(-1_000_000_000 * (bits.nominal * data + bits.data * nominal) // (nominal * data))


class SentMessage(NamedTuple):
    """A message on the bus.

    ``bound``  with the longest that any payload can be
    ``frame``  with zeros as payload
    """

    bound: Traffic
    frame: Frame


def read_messages(
    files: Sequence[Path], periods: Sequence[str], bus: BusSettings
) -> tuple[list[SentMessage], list[str], list[str]]:
    """Return the messages of the files by priority, and the names of those that are left out.

    Left out are long ones of J1939, which need several frames, and those without a period. Raises
    SettingsError for a file that cannot be read, and for two messages of one identifier.
    """
    listed = [message for file in files for message in _read(file)]
    periods_ms = _periods_ms(periods, [message.name for message in listed])
    sent, too_long, left_out = [], [], []
    named: dict[tuple[int, int], str] = {}
    for message in listed:
        if not message.fits_a_frame:
            too_long.append(message.name)
            continue
        period_ms = periods_ms.get(message.name, message.cycle_ms)
        if period_ms is None:
            left_out.append(message.name)
            continue
        key = message.can_id, message.flags & EXTENDED
        if key in named:
            raise SettingsError(
                f"{named[key]} and {message.name} have the same identifier "
                f"0x{message.can_id:X}: on one bus each message needs its own"
            )
        named[key] = message.name
        sent.append(_sent(message, period_ms, bus))
    sent.sort(key=lambda message: message.bound.priority)
    return sent, too_long, left_out


def _read(file: Path) -> tuple[ListedMessage, ...]:
    try:
        return read_message_set(file)
    except OSError as error:
        raise SettingsError(f"{file}: {error.strerror}") from error
    except ValueError as error:
        raise SettingsError(str(error)) from error


def _periods_ms(periods: Sequence[str], names: Sequence[str]) -> Mapping[str, float]:
    given: dict[str, float] = {}
    for text in periods:
        name, _, value = text.partition("=")
        try:
            given[name] = float(value)
        except ValueError:
            given[name] = 0.0
        if name not in names or not 0.1 <= given[name] <= 3_600_000:
            raise SettingsError(
                f"--period {text}: NAME=MS with a message of the files and 0.1 to 3600000 ms"
            )
    return given


def _sent(message: ListedMessage, period_ms: float, bus: BusSettings) -> SentMessage:
    frame = Frame(message.can_id, bytes(message.length), message.flags)
    bound = Traffic(
        message.name,
        arbitration_field(frame),
        bus.duration_ns(most_frame_bits(frame)),
        round(period_ms * NS_PER_MS),
        round(bus.jitter_ms * NS_PER_MS),
    )
    return SentMessage(bound, frame)


class Response(NamedTuple):
    """One message, and its longest response with any payload [ns]; None on an overloaded bus."""

    message: SentMessage
    bound_ns: int | None

    @property
    def is_in_time(self) -> bool | None:
        """Whether the bound meets the deadline; None without a bound."""
        return None if self.bound_ns is None else self.bound_ns <= self.message.bound.period_ns


def respond(messages: Sequence[SentMessage], bus: BusSettings) -> list[Response]:
    """Return the bounds of every message."""
    bounds, wire = [m.bound for m in messages], wire_of(bus.bitrate_bit_s)
    return [Response(one, worst_response_ns(one.bound, bounds, wire)) for one in messages]


def load_of(messages: Sequence[SentMessage], bus: BusSettings) -> float:
    """Return the share of the time that the bus is busy, in the mean."""
    return load([message.bound for message in messages], wire_of(bus.bitrate_bit_s))
