"""Frames of a car as ours, each judged as the car would, and counted by message."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence

from ...runtime.frame import EXTENDED, Frame
from .. import messages as ours
from ..codec.sender_watch import SenderWatch
from ..listening import MessageCounts
from .car_message import CarMessage, Reading, Refused, group_of
from .dialect import Dialect
from .translation import Translation


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
