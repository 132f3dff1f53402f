"""Which received frames a node accepts, and why it refuses the others.

A frame must be intact and within its ranges (``dbc.messages.decode``) and, where its message has a
counter, newer than the newest accepted one (``dbc.codec.sequence_and_second_sender``). Refused
frames are counted by cause.

**Own identifiers.** A node does not receive its own frames, so an intact one under an identifier
that only it sends comes from somebody else, for certain, and its peer may follow that. So for
PAUSE_NS it takes no message. A single such frame stops nobody. While more come, all is silent to
the node, against which it has its fallback; what came of a forged measurement is not followed.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple, TypeVar

from ..runtime.frame import FD, Frame
from ..runtime.node import NEVER_NS, NS_PER_MS
from .codec.sequence_and_second_sender import CHANGING, SequenceCheck, SequenceResult, SequenceRule
from .messages import (
    ACTIVE_CYCLE_TIMES_MS,
    CAN_IDS,
    DATA_IDS,
    MESSAGE_TYPES,
    NUMBERED_WITH,
    Decoded,
    Message,
    Rejection,
    SecondSender,
    decode,
    rejection_of,
    unpacking,
)
from .secoc.secured_frame import Refused, is_secured

Cause = Rejection | SequenceResult | Refused
_Cause = TypeVar("_Cause", Rejection, SequenceResult, Refused)
_ACCEPTED = SequenceResult.ACCEPTED
_OWN, _PEER = int(SecondSender.OWN), int(SecondSender.PEER)
_SECOND_SENDERS = tuple(SecondSender)
NOTICE_NS = 1_000_000_000
"""How long a second sender is reported after its last frame [ns]."""
PAUSE_NS = 50_000_000
"""How long a node takes no message after a frame that only it sends [ns]; a single pause is too
short to end its control. ``tests.soak.forged_frames`` prints what others cost."""


class TakenBack(NamedTuple):
    """A message that is in use again, because those after it may have been forged."""

    message: Message


def second_sender_line(reception: "Reception") -> str:
    """Return in words whose messages have a second sender; empty without any."""
    names = ", ".join(reception.second_senders)
    return f"second sender on the bus: {names}" if names else ""


def cycle_ns(message_type: type[Message]) -> int:
    """Return the period of a message while it is sent."""
    return ACTIVE_CYCLE_TIMES_MS[message_type] * NS_PER_MS


class Reception:
    """Receives some types of messages; frames with other identifiers are ignored.

    ``message_types``  what is received
    ``rule``           what is believed of the counters of each type
    ``sent_types``     what this node alone sends

    ``accepted``, ``refused``  frames so far that came into use, and refused for any cause
    ``sends``   whether the node sends its messages now. One that still waits for others to begin
                does not pause: with its own frames it will contradict those that now are followed
    """

    def __init__(
        self,
        message_types: Collection[type[Message]],
        rule: SequenceRule,
        sent_types: Collection[type[Message]] = (),
    ) -> None:
        self._checks = {
            CAN_IDS[message_type]: None
            if message_type not in DATA_IDS  # sent by hand, so it has no counter
            else SequenceCheck(rule, cycle_ns(message_type))
            for message_type in message_types
            if message_type not in NUMBERED_WITH
        }
        self._received = {
            CAN_IDS[message_type]: (
                *unpacking(message_type),
                self._checks[CAN_IDS[NUMBERED_WITH.get(message_type, message_type)]],
            )
            for message_type in message_types
        }
        self._taken = self._received
        self._sent_ids = {CAN_IDS[message_type] for message_type in sent_types}
        self._own_seen: set[int] = set()
        self._own_ns = -NEVER_NS
        self._paused_until_ns = -NEVER_NS
        self._rejected: Counter[str] = Counter()
        self.sends = True
        self.accepted = 0
        self.refused = 0

    @property
    def rejected(self) -> Mapping[str, int]:
        """Frames refused so far, by cause."""
        return dict(sorted(self._rejected.items()))

    @property
    def resynchronised(self) -> int:
        """How often a restart of a sender was accepted."""
        checks = self._checks.values()
        return sum(check.resynchronised for check in checks if check is not None)

    @property
    def lost(self) -> int:
        """Frames that never arrived or arrived too late, by the counters of accepted frames."""
        return sum(check.lost for check in self._checks.values() if check is not None)

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
        number = _OWN if now_ns - self._own_ns < NOTICE_NS else 0
        for check in self._checks.values():
            noticed_ns = None if check is None else check.second_sender_ns
            if noticed_ns is not None and now_ns - noticed_ns < NOTICE_NS:
                number |= _PEER
        return _SECOND_SENDERS[number]

    def newest(self, message_type: type[Message]) -> SequenceCheck:
        """Return the record of counter and arrival of a message's newest accepted frame."""
        check = self._checks[CAN_IDS[message_type]]
        if check is None:
            raise ValueError(f"{message_type.__name__} has no counter")
        return check

    def take(self, frame: Frame, now_ns: int = 0) -> Message | TakenBack | Cause | None:
        """Return a frame's message, the cause of its refusal, or None if it is not received here.

        Beside a second sender it may be the message of an earlier frame, which comes into use now.
        It is TakenBack where others after it have been in use.

        ``now_ns``  when it arrived
        """
        can_id, data, flags = frame
        received = self._taken.get(can_id)
        if received is None:
            return self._take_other(frame, now_ns)
        length, wanted_flags, unpack, check = received
        if flags != wanted_flags or len(data) != length:
            return self._refuse_unread(frame)
        unpacked = unpack(data)
        if type(unpacked) is not tuple:
            return self._refuse_unread(frame)
        message, counter = unpacked
        if check is not None:
            result = check.check(counter, now_ns, data)
            if result is not _ACCEPTED:
                return self._later(result, check)
        self.accepted += 1
        return message

    def _later(
        self, result: SequenceResult, check: SequenceCheck
    ) -> Message | TakenBack | SequenceResult:
        """Return what to act on after a frame that is not used at once."""
        if result is SequenceResult.CONFIRMED:
            self.accepted += 1
        elif result is not SequenceResult.WAITING:
            self._refuse(result)
        if result in CHANGING and isinstance(check.content, bytes):
            message = self._message_of(check, check.content)
            if message is not None and result is SequenceResult.TAKEN_BACK:
                return TakenBack(message)
            return message or result
        return result

    def _message_of(self, check: SequenceCheck, data: bytes) -> Message | None:
        """Return the message of an earlier frame; its length says which of two in one sequence."""
        for length, _, unpack, its in self._received.values():
            if its is check and length == len(data):
                unpacked = unpack(data)
                return unpacked[0] if isinstance(unpacked, tuple) else None
        return None

    def _take_other(self, frame: Frame, now_ns: int) -> Message | TakenBack | Cause | None:
        """Take a frame that is not received here, or not in a pause."""
        can_id = frame.can_id
        if can_id in self._sent_ids:
            self._notice_own(frame, now_ns)
            return self._refuse(Rejection.OWN_IDENTIFIER)
        if can_id not in self._received:
            return None
        if now_ns < self._paused_until_ns:
            return self._refuse(Rejection.PAUSED)
        self._taken = self._received
        return self.take(frame, now_ns)

    def _notice_own(self, frame: Frame, now_ns: int) -> None:
        """Note a frame that only this node sends; an intact one begins a pause."""
        self._own_seen.add(frame.can_id)
        self._own_ns = now_ns
        if self.sends and isinstance(decode(frame), Decoded):
            self._paused_until_ns, self._taken = now_ns + PAUSE_NS, {}

    def _refuse_unread(self, frame: Frame) -> Rejection | Refused:
        """Refuse a frame that is not a valid message, for the cause found by ``rejection_of``."""
        if frame.flags & FD and is_secured(frame):  # with a key, the classic frame arrives here
            return self._refuse(Refused.NO_KEY)
        return self._refuse(rejection_of(frame))

    def _refuse(self, cause: _Cause) -> _Cause:
        self._rejected[cause.value] += 1
        self.refused += 1
        return cause
