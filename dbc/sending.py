"""The frames that a node sends: those of one type have counters in turn."""

from typing import Any

from ..runtime.frame import Frame
from ..runtime.record import new_record
from .codec.protection import COUNTERS
from .messages import Message, encode_not_available, packing


class Sender:
    """Makes the frames of one type of message; ``counter`` is that of the next one."""

    def __init__(self, message_type: type[Message]) -> None:
        self._can_id, self._pack, self._flags = packing(message_type)
        self.counter = 0

    def frame(self, message: tuple[Any, ...]) -> Frame:
        """Return the next frame of a message; raises EncodeError as ``encode`` does.

        The message's values alone, in their order, save the time of making it.
        """
        counter, pack = self.counter, self._pack
        self.counter = (counter + 1) % COUNTERS
        return new_record(Frame, (self._can_id, pack(message, counter), self._flags))

    def not_available(self, message: Message) -> Frame:
        """Return the next frame, as ``encode_not_available`` does."""
        counter = self.counter
        self.counter = (counter + 1) % COUNTERS
        return encode_not_available(message, counter)
