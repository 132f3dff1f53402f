"""The messages of the given files as traffic of one bus."""

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ...dbc.message_set import ListedMessage, read_message_set
from ...runtime.arbitration import arbitration_field
from ...runtime.bus_model import BusModel
from ...runtime.frame import Frame
from ...runtime.frame_length import FrameBits
from ...runtime.settings import SettingsError
from ...wire.longest_frame import longest_frame
from ...wire.response_times import Traffic, Wire, wire_of

_NS_PER_MS = 1_000_000


class BusSettings(NamedTuple):
    """The bus, as given by the options."""

    bitrate_bit_s: int
    data_bitrate_bit_s: int
    jitter_ms: float
    error_interval_ms: float | None
    errors: int = 0
    bit_error_rate: float | None = None

    def model(self) -> BusModel:
        """Return a new bus, for a simulation."""
        return BusModel(self.bitrate_bit_s, self.data_bitrate_bit_s)

    def wire(self, granularity_ns: int | None = None) -> Wire:
        """Return what the analysis needs of the bus."""
        interval_ms = self.error_interval_ms
        interval_ns = None if interval_ms is None else max(1, round(interval_ms * _NS_PER_MS))
        wire = wire_of(self.bitrate_bit_s, interval_ns, granularity_ns)
        return wire._replace(errors=self.errors)

    def duration_ns(self, bits: FrameBits) -> int:
        """Return how long so many bits take, rounded up [ns]."""
        nominal, data = self.bitrate_bit_s, self.data_bitrate_bit_s
        return -(-1_000_000_000 * (bits.nominal * data + bits.data * nominal) // (nominal * data))


class SentMessage(NamedTuple):
    """A message on the bus.

    ``bound``    with the longest that any payload can be
    ``found``    with the longest payload found, which is ``frame``
    """

    bound: Traffic
    found: Traffic
    frame: Frame


def read_messages(
    files: Sequence[Path], periods: Sequence[str], bus: BusSettings
) -> tuple[list[SentMessage], list[str]]:
    """Return the messages with a period by priority, and the names of those without.

    Raises SettingsError for a file that cannot be read, and for two messages of one identifier.
    """
    listed = [message for file in files for message in _read(file)]
    periods_ms = _periods_ms(periods, [message.name for message in listed])
    sent, left_out = [], []
    for message in listed:
        period_ms = periods_ms.get(message.name, message.cycle_ms)
        if period_ms is None:
            left_out.append(message.name)
        else:
            sent.append(_sent(message, period_ms, bus))
    sent.sort(key=lambda message: message.bound.priority)
    for one, other in itertools.pairwise(sent):
        if one.bound.priority == other.bound.priority:
            raise SettingsError(
                f"{one.bound.name} and {other.bound.name} have the same identifier "
                f"0x{one.frame.can_id:X}: on one bus each message needs its own"
            )
    return sent, left_out


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
    longest = longest_frame(message.can_id, message.length, message.flags)
    bound = Traffic(
        message.name,
        arbitration_field(longest.frame),
        bus.duration_ns(longest.bound),
        round(period_ms * _NS_PER_MS),
        round(bus.jitter_ms * _NS_PER_MS),
    )
    found = bound._replace(frame_ns=bus.duration_ns(longest.found))
    return SentMessage(bound, found, longest.frame)
