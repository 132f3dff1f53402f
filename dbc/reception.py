"""Which received frames a node accepts, and why it refuses the others.

A frame must be intact and within its ranges (``dbc.messages.decode``) and, where its message has a
counter, newer than the newest accepted one (``dbc.protection.SequenceCheck``). Refused frames are
counted by cause.
"""

from collections import Counter
from collections.abc import Collection, Mapping
from typing import TypeVar

from ..runtime.frame import FD, Frame
from .messages import CAN_IDS, DATA_IDS, Message, Rejection, rejection_of, unpacking
from .protection import SequenceCheck, SequenceResult
from .secured_frame import Refused, is_secured

_Cause = TypeVar("_Cause", Rejection, SequenceResult, Refused)
_ACCEPTED = SequenceResult.ACCEPTED


class Reception:
    """Receives some types of messages; frames with other identifiers are ignored.

    ``message_types``  what is received
    ``max_jump``       see SequenceCheck; each type has its own
    ``resync_run``     see SequenceCheck
    ``resync_ns``      see SequenceCheck [ns]

    ``accepted``, ``refused``  frames so far, refused for any cause
    """

    def __init__(
        self,
        message_types: Collection[type[Message]],
        max_jump: int,
        resync_run: int,
        resync_ns: int = 0,
    ) -> None:
        self._checks = {
            CAN_IDS[message_type]: None
            if message_type not in DATA_IDS  # sent by hand, so it has no counter
            else SequenceCheck(max_jump, resync_run, resync_ns)
            for message_type in message_types
        }
        self._received = {
            CAN_IDS[message_type]: (*unpacking(message_type), self._checks[CAN_IDS[message_type]])
            for message_type in message_types
        }
        self._rejected: Counter[str] = Counter()
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

    def newest(self, message_type: type[Message]) -> SequenceCheck:
        """Return the record of counter and arrival of a message's newest accepted frame."""
        check = self._checks[CAN_IDS[message_type]]
        if check is None:
            raise ValueError(f"{message_type.__name__} has no counter")
        return check

    def take(
        self, frame: Frame, now_ns: int = 0
    ) -> Message | Rejection | SequenceResult | Refused | None:
        """Return a frame's message, the cause of its refusal, or None if it is not received here.

        ``now_ns``  when it arrived; not needed without ``resync_ns``
        """
        can_id, data, flags = frame
        received = self._received.get(can_id)
        if received is None:
            return None
        length, unpack, check = received
        if flags or len(data) != length:
            return self._refuse_unread(frame)
        unpacked = unpack(data)
        if type(unpacked) is not tuple:
            return self._refuse_unread(frame)
        message, counter = unpacked
        if check is not None:
            result = check.check(counter, now_ns)
            if result is not _ACCEPTED:
                return self._refuse(result)
        self.accepted += 1
        return message

    def _refuse_unread(self, frame: Frame) -> Rejection | Refused:
        """Refuse a frame that is not a valid message, for the cause found by ``rejection_of``."""
        if frame.flags & FD and is_secured(frame):  # with a key, the classic frame arrives here
            return self._refuse(Refused.NO_KEY)
        return self._refuse(rejection_of(frame))

    def _refuse(self, cause: _Cause) -> _Cause:
        self._rejected[cause.value] += 1
        self.refused += 1
        return cause
