"""Reception: which received frames a node accepts, and why it refuses the others.

A frame must be intact and within its ranges (``dbc.messages.decode``) and, where its message has a
counter, in sequence (``dbc.codec.counter_rule``). Refused frames are counted by cause.

A second sender is reported, of a message that is received (``dbc.codec.second_sender``) or that
this node alone sends: a node does not receive its own frames, except for the echo that some CAN
adapters return, which is one of its last ECHO_TICKS ticks.
"""

from collections import Counter, deque
from collections.abc import Collection, Mapping, Sequence
from typing import Literal, TypeVar

from ..runtime.frame import ERROR, EXTENDED, FD, REMOTE, Frame
from ..runtime.node import NEVER_NS, NS_PER_MS
from .codec.counter_check import CounterCheck
from .codec.counter_rule import CounterResult, CounterRule
from .codec.sender_watch import ECHO_TICKS
from .messages import (
    ACTIVE_CYCLE_TIMES_MS,
    CAN_IDS,
    CODECS,
    EVENTS,
    MESSAGE_TYPES,
    NUMBERED_WITH,
    Message,
    Rejection,
    SecondSender,
    cause_of,
    misfit_of,
)
from .secoc.secured_frame import Refused, is_secured

Cause = Rejection | CounterResult | Refused
_Cause = TypeVar("_Cause", Rejection, CounterResult, Refused)
_ACCEPTED = CounterResult.ACCEPTED
NOTICE_NS = 1_000_000_000
"""How long a second sender is reported after its last frame [ns]."""
SecondSenderAction = Literal["report", "silent"]
"""What a node does while there is a second sender: it only reports it, or no longer acts."""


def cycle_ns(message_type: type[Message]) -> int:
    """Return the period of a message while it is sent."""
    return ACTIVE_CYCLE_TIMES_MS[message_type] * NS_PER_MS


def second_sender_at(own_ns: int | None, peer_ns: int | None, now_ns: int) -> SecondSender:
    """Return whose messages have come from a second sender in the last NOTICE_NS.

    ``own_ns``, ``peer_ns``  when a frame last showed one, of own messages and of received ones
    """
    is_own = own_ns is not None and now_ns - own_ns < NOTICE_NS
    if peer_ns is not None and now_ns - peer_ns < NOTICE_NS:
        return SecondSender.BOTH if is_own else SecondSender.PEER
    return SecondSender.OWN if is_own else SecondSender.NONE


class Reception:
    """Receives some types of messages; frames with other identifiers are ignored.

    ``message_types``  what is received
    ``rule``           which counters are accepted
    ``sent_types``     what this node alone sends

    ``is_silent``  whether no message with a counter is accepted while there is a second sender
    ``accepted``, ``refused``  frames so far that were accepted, and refused for any cause
    """

    def __init__(
        self,
        message_types: Collection[type[Message]],
        rule: CounterRule,
        sent_types: Collection[type[Message]] = (),
    ) -> None:
        self._checks = {
            CAN_IDS[message_type]: None
            if message_type in EVENTS
            else CounterCheck(rule._replace(period_ns=cycle_ns(message_type)))
            for message_type in message_types
            if message_type not in NUMBERED_WITH
        }
        self._counted = [check for check in self._checks.values() if check is not None]
        self._received = {
            codec.can_id: (
                codec.length,
                codec.flags,
                codec.unpack,
                self._checks[CAN_IDS[NUMBERED_WITH.get(message_type, message_type)]],
            )
            for message_type in message_types
            for codec in [CODECS[message_type]]
        }
        self._sent_ids = {CAN_IDS[message_type] for message_type in sent_types}
        self._sent: deque[Sequence[Frame]] = deque(maxlen=ECHO_TICKS)
        self.on_sent = self._sent.append
        self._own_seen: set[int] = set()
        self._own_ns = -NEVER_NS
        self._rejected: Counter[str] = Counter()
        self.is_silent = False
        self.accepted = 0
        self.refused = 0

    @property
    def rejected(self) -> Mapping[str, int]:
        """Frames refused so far, by cause."""
        return dict(sorted(self._rejected.items()))

    @property
    def resynchronised(self) -> int:
        """How often a restart of a sender was accepted."""
        return sum(check.resynchronised for check in self._counted)

    @property
    def lost(self) -> int:
        """Frames that never arrived or arrived too late, by the counters of accepted frames."""
        return sum(check.lost for check in self._counted)

    @property
    def second_senders(self) -> Sequence[str]:
        """Names of the messages, sent or received here, that have had a second sender."""
        seen = self._own_seen | {
            can_id
            for can_id, check in self._checks.items()
            if check is not None and check.second_sender_ns is not None
        }
        return [name for name, kind in MESSAGE_TYPES.items() if CAN_IDS[kind] in seen]

    def second_sender(self, now_ns: int) -> SecondSender:
        """Return whose messages have come from a second sender in the last NOTICE_NS."""
        seen_ns = [it.second_sender_ns for it in self._counted if it.second_sender_ns is not None]
        return second_sender_at(self._own_ns, max(seen_ns, default=None), now_ns)

    def newest(self, message_type: type[Message]) -> CounterCheck:
        """Return the record of counter and arrival of a message's newest accepted frame."""
        check = self._checks[CAN_IDS[message_type]]
        if check is None:
            raise ValueError(f"{message_type.__name__} has no counter")
        return check

    def receive(self, frame: Frame, now_ns: int = 0) -> Message | Cause | None:
        """Return a frame's message, the cause of its refusal, or None if it is not received."""
        can_id, data, flags = frame
        received = self._received.get(can_id)
        if received is None:
            return self._take_own(frame, now_ns) if can_id in self._sent_ids else None
        length, wanted_flags, unpack, check = received
        if flags != wanted_flags or len(data) != length:
            if flags & FD and is_secured(frame):  # with a key, the classic frame arrives here
                return self.refuse(Refused.NO_KEY)
            return self.refuse(misfit_of(frame))
        unpacked = unpack(data)
        if not isinstance(unpacked, tuple):  # to ask for an enumeration takes thirty times as long
            return self.refuse(cause_of(unpacked, can_id, data))
        message, counter = unpacked
        if check is not None:
            result = check.check(counter, now_ns, data)
            if result is not _ACCEPTED:
                return self.refuse(result)
            if self.is_silent and self.second_sender(now_ns):
                return self.refuse(Rejection.SECOND_SENDER)
        self.accepted += 1
        return message

    def _take_own(self, frame: Frame, now_ns: int) -> Rejection | None:
        """Refuse a frame that only this node sends, unless it is the echo of its own."""
        can_id, data, flags = frame
        if flags & (ERROR | EXTENDED | REMOTE):  # another identifier, or none
            return self.refuse(Rejection.WRONG_FORMAT)
        for frames in reversed(self._sent):
            if any(sent.can_id == can_id and sent.data == data for sent in frames):
                return None
        self._own_seen.add(can_id)
        self._own_ns = now_ns
        return self.refuse(Rejection.OWN_IDENTIFIER)

    def refuse(self, cause: _Cause) -> _Cause:
        """Count a refused frame by its cause, and return that."""
        self._rejected[cause.name.lower()] += 1
        self.refused += 1
        return cause
