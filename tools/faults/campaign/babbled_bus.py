"""A bus with a babbling node on it, as the wire of a virtual-time executor."""

from collections.abc import Sequence

from ....runtime.bus_model.bus_model import BusModel, Delivery
from ....runtime.bus_model.transmit_queue import BusOverflowError
from ....runtime.frame import Frame
from ....runtime.node import NEVER_NS
from ..injection.fault_frames import babble

BABBLER_ID = 0x000
"""It wins the arbitration against every frame of the pair."""
_BABBLER = -1


class BabbledBus:
    """The bus of a run, and the babbling node as one more sender.

    ``model``     the bus, which has no other sender
    ``can_id``    of the babbling node
    ``start_ns``  when it begins, ``end_ns`` when it stops [ns]

    The nodes do not get its frames: on a real bus their receive filters keep them away. A node's
    frame that finds its queue full is lost and counted, as in a transmit queue that is full.
    """

    def __init__(self, model: BusModel, can_id: int, start_ns: int, end_ns: int) -> None:
        self._model = model
        self._can_id = can_id
        self._start_ns = start_ns
        self._end_ns = end_ns
        self._is_ready = False
        self.babbled = self.refused = 0

    @property
    def next_event_ns(self) -> int:
        """When the next frame is complete, or when the babbling begins [ns]."""
        begins_ns = NEVER_NS if self.babbled or self._is_ready else self._start_ns
        return min(self._model.next_event_ns, begins_ns)

    def submit(self, frame: Frame, sender: int, now_ns: int) -> None:
        """Take a frame of a node, if there is room."""
        try:
            self._model.submit(frame, sender, now_ns)
        except BusOverflowError:
            self.refused += 1

    def advance(self, now_ns: int) -> Sequence[Delivery]:
        """Return the frames of the nodes completed up to ``now_ns``, in order of completion."""
        completed = self._model.advance(now_ns)
        others = [delivery for delivery in completed if delivery.sender != _BABBLER]
        if len(others) < len(completed):
            self._is_ready = False
            self.babbled += len(completed) - len(others)
        # The next arbitration is after the intermission, so this is in time for it.
        if not self._is_ready and self._start_ns <= now_ns < self._end_ns:
            self._model.submit(babble(self._can_id, self.babbled), _BABBLER, now_ns)
            self._is_ready = True
        return others
