"""The pair's bus as it is in a vehicle: with other people's traffic, and with noise.

Every periodic message of some databases is sent beside the pair's. Each has its cycle time, a phase
of its own and a payload whose first byte counts; the other bytes and the phases are drawn from the
seed. Messages without a cycle time are not sent, nor are those whose identifier the pair uses.
"""

from collections.abc import Callable, Sequence
from heapq import heapify, heapreplace
from typing import NamedTuple

import numpy as np

from ..dbc.message_set import ListedMessage
from ..dbc.messages import CAN_IDS
from ..runtime.bus_errors import BusErrors
from ..runtime.bus_model import BusModel, BusOverflowError, Delivery
from ..runtime.error_frames import error_frame
from ..runtime.frame import EXTENDED, Frame
from ..runtime.frame_length import INTERMISSION_BITS, frame_bits
from ..runtime.node import NEVER_NS, NS_PER_MS, NS_PER_S

OnWire = Callable[[int, int, Frame], None]
"""Called as ``on_wire(end_ns, sender, frame)``."""


class Sent(NamedTuple):
    """One message of the rest of the bus: its frames in turn, and its period [ns]."""

    name: str
    frames: tuple[Frame, ...]
    period_ns: int


def rest_of(
    messages: Sequence[ListedMessage], seed: int, bitrate_bit_s: int, load: float | None = None
) -> list[Sent]:
    """Return what is sent; with ``load``, as often as gives this share of the bus, 0 to 1.

    Raises ValueError where no message has a cycle time, or two have the same identifier.
    """
    own = set(CAN_IDS.values())
    others = [m for m in messages if m.cycle_ms and (m.flags & EXTENDED or m.can_id not in own)]
    if not others:
        raise ValueError("no message has a cycle time")
    identifiers = [(m.can_id, m.flags & EXTENDED) for m in others]
    if len(set(identifiers)) < len(identifiers):
        raise ValueError("two messages have the same identifier; each needs its own on one bus")
    random = np.random.default_rng(seed)
    sent = []
    for message in others:
        rest = random.integers(256, size=max(0, message.length - 1), dtype=np.uint8).tobytes()
        counts = range(256) if message.length else range(1)
        frames = tuple(
            Frame(message.can_id, (bytes([count]) + rest)[: message.length], message.flags)
            for count in counts
        )
        sent.append(Sent(message.name, frames, (message.cycle_ms or 0) * NS_PER_MS))
    if load is None:
        return sent
    faster = load_of(sent, bitrate_bit_s) / load
    return [one._replace(period_ns=max(1, round(one.period_ns * faster))) for one in sent]


def load_of(messages: Sequence[Sent], bitrate_bit_s: int) -> float:
    """Share of the bus that the messages take, with intermissions, at the nominal rate."""
    return sum(
        (sum(frame_bits(message.frames[0])) + INTERMISSION_BITS)
        * NS_PER_S
        / (bitrate_bit_s * message.period_ns)
        for message in messages
    )


class SharedBus:
    """A bus with other traffic on it, as the wire of a virtual-time executor.

    ``model``     the bus; nobody else may submit to it
    ``messages``  what is sent beside the nodes' frames
    ``errors``    of the model, if it has any

    ``frames``    of the other messages, complete
    ``refused``   frames that found their transmit buffer full and are lost, the nodes' among them

    The nodes do not get the others' frames: their receive filters keep them away.
    """

    def __init__(
        self,
        model: BusModel,
        messages: Sequence[Sent] = (),
        seed: int = 0,
        errors: BusErrors | None = None,
    ) -> None:
        self.model = model
        self.errors = errors
        self._messages = messages
        self._on_wire: OnWire | None = None
        phases = np.random.default_rng((seed, 1))
        self._due = [
            (int(phases.integers(message.period_ns)), index, 0)
            for index, message in enumerate(messages)
        ]
        heapify(self._due)
        self._next_due_ns = self._due[0][0] if self._due else NEVER_NS
        self.frames = 0
        self.refused = 0

    def watch(self, on_wire: OnWire) -> None:
        """Have every frame that the nodes do not get reported, error frames among them."""
        self._on_wire = on_wire
        if self.errors is not None:
            self.errors.on_error = lambda event: on_wire(
                event.time_ns, event.sender, error_frame(event)
            )

    @property
    def next_event_ns(self) -> int:
        """When the next frame is complete, or the next one is sent [ns]."""
        return min(self.model.next_event_ns, self._next_due_ns)

    def submit(self, frame: Frame, sender: int, now_ns: int) -> None:
        """Take a frame of a node, if there is room."""
        try:
            self.model.submit(frame, sender, now_ns)
        except BusOverflowError:
            self.refused += 1

    def advance(self, now_ns: int) -> Sequence[Delivery]:
        """Return the frames of the nodes completed up to ``now_ns``, in order of completion."""
        while self._next_due_ns <= now_ns:
            self._send_next()
        completed = self.model.advance(now_ns)
        own = [delivery for delivery in completed if delivery.sender >= 0]
        if len(own) < len(completed):
            self.frames += len(completed) - len(own)
            if self._on_wire is not None:
                for end_ns, sender, frame in completed:
                    if sender < 0:
                        self._on_wire(end_ns, sender, frame)
        return own

    def _send_next(self) -> None:
        due_ns, index, count = self._due[0]
        _, frames, period_ns = self._messages[index]
        heapreplace(self._due, (due_ns + period_ns, index, (count + 1) % len(frames)))
        self._next_due_ns = self._due[0][0]
        self.submit(frames[count], -1 - index, due_ns)
