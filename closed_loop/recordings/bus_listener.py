"""A listener on a bus: messages decoded, and rejected frames counted by cause.

It decides as the nodes do (``dbc.messages.decode``, then the end-to-end counter), with the widest
window: a listener controls nothing, so it may accept any newer counter at any time. Of
authenticated frames it reads the payload only, because it has no key.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ...dbc import messages
from ...dbc.codec.counter_check import CounterCheck
from ...dbc.codec.counter_rule import PERIOD_NS_MIN, CounterResult, CounterRule
from ...dbc.codec.protection import COUNTERS, HALF
from ...dbc.listening import OUR_MESSAGES, Listening, MessageCounts
from ...dbc.secoc.secured_frame import plain
from ...plant_emulator.steering.plan_buffer import planned_rad
from ...runtime.frame import ERROR, Frame

RULE = CounterRule(lead_ns=HALF * PERIOD_NS_MIN, resync_run=20)
"""Accept whatever is newer, and a restart of the sender after 20 rejected counters in a row."""
FOREIGN_IDS_MAX = 1000
"""How many foreign identifiers are counted separately."""

NAMES: Mapping[type[messages.Message], str] = {
    kind: name for name, kind in messages.MESSAGE_TYPES.items()
}
"""The name of each message in the DBC."""
_NAMES_BY_ID = {messages.CAN_IDS[kind]: name for kind, name in NAMES.items()}


class ReceivedMessage(NamedTuple):
    """A message on the bus.

    ``counter``  end-to-end counter, 0 for a message without one
    ``is_late``  overtaken by a newer one: a node would reject it
    ``sample``   counter of the newest measurement before it, 0 before the first
    """

    name: str
    message: messages.Message
    counter: int
    is_late: bool
    sample: int

    @property
    def shown(self) -> messages.Message:
        """The message; in place of a plan the command that it is at the newest measurement."""
        if isinstance(self.message, messages.SteeringPlan):
            return command_at(self.message, self.sample)
        return self.message


def command_at(
    message: messages.SteeringCommand | messages.SteeringPlan, sample: int
) -> messages.SteeringCommand:
    """Return a command, or what a plan commands at the sample with this end-to-end counter."""
    if isinstance(message, messages.SteeringCommand):
        return message
    spacing, steers_rad = message.spacing, messages.steers_of(message)
    age = min((sample - message.first_sample) % COUNTERS, spacing * (len(steers_rad) - 1))
    return messages.SteeringCommand(
        steer_rad=planned_rad(age, spacing, steers_rad),
        command_counter=message.plan_number,
        mode=message.mode,
    )


class Taken(NamedTuple):
    """What a frame on the bus says.

    ``messages``  of ours, those of a car as ours; none for a refused, foreign or duplicate frame
    ``name``      of the car's message; empty for a frame of ours, or one that is refused
    """

    messages: Sequence[ReceivedMessage]
    name: str


class BusListener:
    """Takes every frame on a bus, in order.

    ``foreign``         frames by identifier, for the first FOREIGN_IDS_MAX that the DBC lacks
    ``error_frames``    which the listener's own CAN controller generates
    """

    def __init__(self, listening: Listening = OUR_MESSAGES) -> None:
        self.listening = listening
        self._checks = {
            name: CounterCheck(RULE)
            for kind, name in NAMES.items()
            if kind in messages.DATA_IDS and kind not in messages.NUMBERED_WITH
        }  # others are sent by hand, so it has no counter, or are of another's sequence
        self._heard: dict[str, tuple[int, int, int]] = {}
        """When a sequence began, when its newest frame came [ns], and how many it has."""
        self._lost, self._accepted = Counter[str](), Counter[str]()
        self._late = Counter[str]()
        self._refused = {name: Counter[str]() for name in messages.MESSAGE_TYPES}
        self.foreign = Counter[int]()
        self.foreign_frames = 0
        self.error_frames = 0
        self._sample = 0

    @property
    def refused(self) -> Mapping[str, int]:
        """Rejected frames under identifiers of the DBC, by cause."""
        total = Counter[str]()
        for name in self.listening.listed:
            total.update(self.counts(name).refused)
        return dict(sorted(total.items()))

    def counts(self, name: str) -> MessageCounts:
        """Return the counts of the message called ``name`` on the bus.

        What is missing of one sequence is counted under the first of its messages.
        """
        if (of_car := self.listening.counts(name)) is not None:
            return of_car
        lost = self._checks[name].lost if name in self._checks else 0
        return MessageCounts(
            self._accepted[name],
            self._lost[name] + lost,
            self._late[name],
            dict(sorted(self._refused[name].items())),
        )

    def on_frame(self, frame: Frame, now_ns: int) -> Taken:
        """Take a frame that arrived at ``now_ns``."""
        heard = self.listening.hear(frame, now_ns)
        if heard.is_foreign:
            self._count_foreign(frame.can_id)
        received = (self._take_ours(one, now_ns) for one in heard.ours)
        return Taken([one for one in received if one is not None], heard.name)

    def _take_ours(self, frame: Frame, now_ns: int) -> ReceivedMessage | None:
        decoded = messages.decode(plain(frame))
        if isinstance(decoded, messages.Decoded):
            message, counter = decoded
            kind = type(message)
            name = NAMES[kind]
            numbered = NAMES[messages.NUMBERED_WITH.get(kind, kind)]
            result = self._in_sequence(numbered, counter, now_ns)
            if result is CounterResult.ACCEPTED:
                self._accepted[name] += 1
                if isinstance(message, messages.LateralError):
                    self._sample = counter
                return ReceivedMessage(name, message, counter, False, self._sample)
            if result is CounterResult.OUT_OF_ORDER:
                self._late[name] += 1
                return ReceivedMessage(name, message, counter, True, self._sample)
            self._refused[name][result.name.lower()] += 1
        elif frame.flags & ERROR:
            self.error_frames += 1
        elif decoded is messages.Rejection.UNKNOWN_ID:
            self._count_foreign(frame.can_id)
        else:
            self._refused[_NAMES_BY_ID[frame.can_id]][decoded.value] += 1
        return None

    def _count_foreign(self, can_id: int) -> None:
        self.foreign_frames += 1
        if can_id in self.foreign or len(self.foreign) < FOREIGN_IDS_MAX:
            self.foreign[can_id] += 1

    def _in_sequence(self, name: str, counter: int, now_ns: int) -> CounterResult:
        check = self._checks.get(name)
        if check is None:
            return CounterResult.ACCEPTED
        since_ns, newest_ns, frames = self._heard.get(name, (now_ns, now_ns, 0))
        periods = (frames - 1 + check.lost) * (now_ns - newest_ns) / max(newest_ns - since_ns, 1)
        is_older = (counter - check.counter) % COUNTERS >= HALF
        if frames > RULE.resync_run and periods > (0.5 * HALF if is_older else HALF):
            # The counter may have gone through whole turns, or begun again: any is newer, and skips
            # none. So is an older one after a quarter turn, which no late frame takes.
            self._lost[name] += check.lost
            check = self._checks[name] = CounterCheck(RULE)
            since_ns, frames = now_ns, 0
        result = check.check(counter)
        if result is CounterResult.ACCEPTED:
            self._heard[name] = since_ns, now_ns, frames + 1
        return result
