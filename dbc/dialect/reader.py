"""Frames of a car as ours, each judged as the car would, and counted; for nodes and listeners."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ...runtime.frame import EXTENDED, Frame
from ...runtime.node import NS_PER_S
from ...runtime.node.end import End
from .. import messages as ours
from ..codec.sender_watch import SenderWatch
from ..listening import OUR_MESSAGES, Heard, Listed, Listening, MessageCounts
from .car_message import CarMessage, Reading, Refused, group_of
from .dialect import Dialect
from .quantities import SAID_BY, Values
from .settings import Quantity

_OUR_IDS = frozenset(ours.CAN_IDS.values())


class Translation:
    """Messages of the car as ours.

    A car echoes no counter of a command: that of the last one sent stands for it, so that the delay
    which the controller measures is that of the measurements alone. A quantity that the car lacks
    is 0; one that only says that the car is engaged, or follows commands, is 1.
    """

    def __init__(self, dialect: Dialect) -> None:
        is_engaged = float(Quantity.ENGAGED not in dialect.carried)
        self._known = {**dict.fromkeys(Quantity, 0.0), Quantity.APPLYING: 1.0}
        self._known[Quantity.ENGAGED] = is_engaged
        self._senders: Mapping[type[ours.Message], ours.Sender] = {
            kind: ours.Sender(kind) for kind in SAID_BY
        }
        self._sent_counter = self._number = 0
        self._last: tuple[int, float] | None = None

    def note_sent(self, message: ours.Message) -> None:
        """Keep the counter of the last command."""
        if isinstance(message, ours.SteeringCommand):
            self._sent_counter = message.command_counter

    def frames(self, message: CarMessage, values: Values, now_ns: int) -> Sequence[Frame] | Refused:
        """Return our messages whose first quantity has come, or why the car would refuse it."""
        if why := self._refusal(message, values, now_ns):
            return why
        self._known |= values
        fields: dict[str, Any] = {str(name): value for name, value in self._known.items()}
        fields |= {"applied_counter": self._sent_counter, "command_counter": self._number}
        fields |= {"status": _CODES[_is_one(self._known[Quantity.APPLYING])]}
        fields |= {"mode": ours.Mode.ACTIVE}
        if Quantity.STEER in values:
            self._last = now_ns, values[Quantity.STEER]
            self._number = (self._number + 1) % ours.COMMAND_COUNTERS
        return [
            sender.frame(kind._make(fields[name] for name in kind._fields))
            for kind, sender in self._senders.items()
            if next(iter(SAID_BY[kind])) in values
        ]

    def _refusal(self, message: CarMessage, values: Values, now_ns: int) -> Refused | None:
        if Quantity.ENGAGED in values:
            self._known[Quantity.ENGAGED] = values[Quantity.ENGAGED]
        steer_rad = values.get(Quantity.STEER)
        if steer_rad is not None and not _is_one(self._known[Quantity.ENGAGED]):
            return Refused.NOT_ENGAGED
        if not (math.isfinite(values.get(Quantity.APPLYING, 1.0)) and _is_carried(values)):
            return Refused.OUT_OF_RANGE
        if steer_rad is not None and self._is_too_fast(message, steer_rad, now_ns):
            return Refused.TOO_FAST
        return None

    def _is_too_fast(self, message: CarMessage, steer_rad: float, now_ns: int) -> bool:
        rate_rad_s = message.rate_max_rad_s
        if rate_rad_s is None or self._last is None:
            return False
        since_s = max((now_ns - self._last[0]) / NS_PER_S, 1e-3 * message.settings.cycle_ms)
        return abs(steer_rad - self._last[1]) > rate_rad_s * since_s


_CODES = (ours.SteeringStatusCode.NO_COMMAND, ours.SteeringStatusCode.APPLYING)


_LIMITS: Mapping[Quantity, ours.SignalRange] = {
    name: ours.limits(kind)[name]
    for kind, said in SAID_BY.items()
    for name in said
    if name in ours.limits(kind)
}


def _is_carried(values: Values) -> bool:
    """Whether messages of ours can carry the values; not a number is none."""
    return all(
        _LIMITS[name].minimum <= value <= _LIMITS[name].maximum
        for name, value in values.items()
        if name in _LIMITS
    )


def _is_one(value: float) -> bool:
    """Whether a value is nearest to 1; not a number is not."""
    return 0.5 < value < 1.5


class CarReader:
    """Reads some messages of a dialect.

    ``refused``  frames by message and cause
    ``second_senders``  names of messages that have had a second sender, by their own counters
    """

    def __init__(self, dialect: Dialect, messages: Iterable[CarMessage]) -> None:
        self._known = {(one.can_id, one.flags): one for one in messages}
        self._by_group = {
            group_of(one.can_id): one for one in self._known.values() if one.is_from_any_address
        }
        self._translation = Translation(dialect)
        self._newest: dict[str, int] = {}
        self._newest_accepted: dict[str, int] = {}
        """Counters, by message."""
        self._accepted, self._missing = Counter[str](), Counter[str]()
        self.refused = defaultdict[str, Counter[str]](Counter)
        self._watches = {
            one.name: SenderWatch(one.counters)
            for one in self._known.values()
            if one.settings.counter
        }
        self.second_senders = list[str]()

    def message_of(self, frame: Frame) -> CarMessage | None:
        """Return the message in a frame, by its group where J1939's address is left open."""
        message = self._known.get((frame.can_id, frame.flags))
        if message is None and self._by_group and frame.flags == EXTENDED:
            message = self._by_group.get(group_of(frame.can_id))
        return message

    def note_sent(self, message: ours.Message) -> None:
        """Take note of a message of ours that the peer's may answer."""
        self._translation.note_sent(message)

    def read(self, message: CarMessage, frame: Frame, now_ns: int) -> Sequence[Frame] | Refused:
        """Return what a frame of one of the messages says as frames of ours."""
        reading = message.read(frame.data)
        if isinstance(reading, Reading) and message.settings.counter:
            watch = self._watches[message.name]
            watch.on_frame(reading.counter, now_ns, frame.data)
            if watch.shows and message.name not in self.second_senders:
                self.second_senders.append(message.name)
        said = self._judged(message, reading, now_ns)
        if isinstance(said, Refused) or isinstance(reading, Refused):
            self.refused[message.name][str(said)] += 1
            return said
        self._accepted[message.name] += 1
        before = self._newest_accepted.get(message.name, reading.counter - 1)
        self._missing[message.name] += (reading.counter - before - 1) % message.counters
        self._newest_accepted[message.name] = reading.counter
        return said

    def counts(self, name: str) -> MessageCounts:
        """Return the counts of a message."""
        refused = dict(sorted(self.refused[name].items()))
        return MessageCounts(self._accepted[name], self._missing[name], 0, refused)

    def totals(self) -> tuple[int, dict[str, int]]:
        """Return how many frames were accepted, and refused by cause."""
        causes = sum(self.refused.values(), Counter[str]())
        return self._accepted.total(), dict(sorted(causes.items()))

    def _judged(
        self, message: CarMessage, reading: Reading | Refused, now_ns: int
    ) -> Sequence[Frame] | Refused:
        if isinstance(reading, Refused):
            return reading
        if message.settings.counter:
            before = self._newest.get(message.name)
            self._newest[message.name] = reading.counter
            if before == reading.counter:
                return Refused.REPEATED
        return self._translation.frames(message, reading.values, now_ns)


def listening_to(dialect: Dialect) -> Listening:
    """Return a listener that reads frames as both nodes would; it can measure no round trip."""
    reader, messages = CarReader(dialect, dialect.messages), dialect.messages
    kept = {name: it for name, it in OUR_MESSAGES.listed.items() if it.can_id in dialect.kept_ids}
    of_car = {one.name: Listed(one.can_id, one.settings.cycle_ms) for one in messages}
    of_plant = frozenset(one.can_id for one in dialect.sent_by(End.PLANT))
    signals = {
        carried.carries.value: f"{one.name}.{signal}"
        for one in messages
        for signal, carried in one.settings.signals.items()
    }
    names = {
        name: signals[first].partition(".")[0]
        for name, kind in ours.MESSAGE_TYPES.items()
        if (first := next(iter(SAID_BY.get(kind, ())), "")) in signals
    }

    def hear(frame: Frame, now_ns: int) -> Heard:
        message = reader.message_of(frame)
        if message is None:
            is_kept = frame.can_id in dialect.kept_ids or frame.can_id not in _OUR_IDS
            if is_kept:
                _note(reader, frame)
            return Heard((frame,) if is_kept else (), is_foreign=not is_kept)
        said = reader.read(message, frame, now_ns)
        if isinstance(said, Refused):
            return Heard(())
        for one in said:
            _note(reader, one)
        return Heard(said, message.name)

    def counts(name: str) -> MessageCounts | None:
        return reader.counts(name) if name in of_car else None

    return Listening(
        {**of_car, **kept},
        OUR_MESSAGES.from_plant & dialect.kept_ids | of_plant,
        signals,
        names,
        {one.name: one for one in messages},
        hear,
        counts,
    )


def _note(reader: CarReader, frame: Frame) -> None:
    """Let the statuses name a command that is not on its way, since a car names none."""
    decoded = ours.decode(frame)
    if isinstance(decoded, ours.Decoded) and isinstance(decoded.message, ours.SteeringCommand):
        message = decoded.message
        counter = message.command_counter + ours.COMMAND_COUNTERS // 2
        counter %= ours.COMMAND_COUNTERS
        reader.note_sent(message._replace(command_counter=counter))
