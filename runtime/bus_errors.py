"""Errors on the bus: noise destroys frames, their senders repeat them, and controllers count.

    noise        when a bit is wrong (``bus_noise``)
    consequence  which frame that destroys and how long it takes (``disturbed_frame``)
    counters     of every node that has been on the bus (``fault_confinement``)

Everyone but the sender receives: each other node has a receive counter.
"""

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from .bus_noise import BusNoise
from .disturbed_frame import Disturbed, disturb
from .fault_confinement import ControllerState, ErrorCounters
from .frame import BITRATE_SWITCH, Frame
from .frame_length import frame_bits
from .frame_on_wire import frame_on_wire

SUSPEND_BITS = 8
"""How much longer than others an error passive sender waits after a frame of its own."""
BUS_OFF_SEQUENCES, SEQUENCE_BITS = 128, 11


class ErrorEvent(NamedTuple):
    """One destroyed transmission, as the sender's controller reports it.

    ``time_ns``   end of the error delimiter [ns]
    ``state``     of the sender's controller afterwards; ``has_changed`` with this error
    """

    time_ns: int
    sender: int
    frame: Frame
    cause: str
    field: str
    transmit_errors: int
    receive_errors: int
    state: ControllerState
    has_changed: bool


class _Member:
    """A node on the bus: its counters, which lag behind the frames that came through."""

    def __init__(self) -> None:
        self.counters = ErrorCounters()
        self.own_frames = 0
        self.all_frames = 0


class BusErrors:
    """What a BusModel asks about errors; one for each bus.

    ``noise``     when bits are wrong
    ``on_error``  called for every destroyed transmission

    ``is_calm``   everybody is error active
    ``sent``      complete frames by sender; whoever sends one counts it here or by ``on_whole``
    """

    def __init__(
        self, noise: BusNoise, on_error: Callable[[ErrorEvent], None] | None = None
    ) -> None:
        self._noise = noise
        self.on_error = on_error
        self._members: dict[int, _Member] = {}
        self._limited: set[int] = set()
        self.is_calm = True
        self.sent: Counter[int] = Counter()
        self.causes: Counter[str] = Counter()
        self.received_twice = 0
        self.bus_offs = 0

    def join(self, node: int) -> None:
        """Have counters for this node."""
        if node not in self._members:
            member = self._members[node] = _Member()
            member.all_frames = self.sent.total()

    def counters(self, node: int) -> ErrorCounters:
        """Return a node's counters as they are now."""
        return self._up_to_date(node, self.sent.total()).counters

    def is_passive(self, node: int) -> bool:
        """Whether a node must pause after its frames."""
        return node in self._limited and self.counters(node).is_passive

    def is_off(self, node: int) -> bool:
        """Whether a node takes no part."""
        return node in self._limited and (
            self._members[node].counters.state is ControllerState.BUS_OFF
        )

    def restart(self, node: int) -> None:
        """Let a node take part again."""
        self.counters(node).restart()
        self._note_limits(node)

    def next_hit_ns(self, start_ns: int, end_ns: int) -> int | None:
        """Return the first instant from ``start_ns`` on, before ``end_ns``, with a wrong bit."""
        return self._noise.first_hit_ns(start_ns, end_ns)

    def transmission(
        self, frame: Frame, sender: int, start_ns: float, bit_ns: float, data_bit_ns: float
    ) -> Disturbed | None:
        """Return what noise does to a frame from ``start_ns`` on; None if it stays whole.

        ``bit_ns``, ``data_bit_ns``  length of a nominal and of a data bit [ns]
        """
        # A whole frame cannot take longer, so that its bits are only laid out when one is hit.
        longest_ns = (len(frame.data) * 10 + 120) * bit_ns
        hit_ns = self._noise.first_hit_ns(int(start_ns), int(start_ns + longest_ns))
        if hit_ns is None:
            return None
        index = _bit_at(frame, hit_ns - start_ns, bit_ns, data_bit_ns)
        if index is None:
            return None
        return disturb(frame, index, is_passive=self.is_passive(sender))

    def on_whole(self, sender: int) -> None:
        """Count a frame that was sent and received."""
        self.sent[sender] += 1
        if not self.is_calm:
            for node in tuple(self._limited):
                self._note_limits(node)

    def on_disturbed(self, disturbed: Disturbed, sender: int, frame: Frame, time_ns: int) -> None:
        """Count a destroyed transmission and report it."""
        total = self.sent.total()
        own = self._up_to_date(sender, total).counters
        before = own.state
        for node in self._members:
            counters = self._up_to_date(node, total).counters
            if node == sender and disturbed.is_transmit_error:
                counters.on_transmit_error()
            elif not disturbed.is_received or node == sender:
                counters.on_receive_error()
            else:
                counters.on_received()
            if counters.is_passive or node in self._limited:
                self._note_limits(node)
        self.causes[disturbed.cause] += 1
        self.received_twice += disturbed.is_received
        self.bus_offs += own.state is ControllerState.BUS_OFF
        if self.on_error is not None:
            event = ErrorEvent(
                time_ns,
                sender,
                frame,
                disturbed.cause,
                disturbed.field,
                own.transmit,
                own.receive,
                own.state,
                own.state is not before,
            )
            self.on_error(event)

    def _note_limits(self, node: int) -> None:
        if self.counters(node).is_passive:
            self._limited.add(node)
        else:
            self._limited.discard(node)
        self.is_calm = not self._limited

    def _up_to_date(self, node: int, total: int) -> _Member:
        """Let the counters of a node see the frames that have come through since last time."""
        member = self._members[node]
        own = self.sent[node]
        new_own = own - member.own_frames
        new_others = total - member.all_frames - new_own
        member.own_frames, member.all_frames = own, total
        if member.counters.state is not ControllerState.BUS_OFF:
            member.counters.on_sent(new_own)
            member.counters.on_received(new_others)
        return member


def _bit_at(frame: Frame, offset_ns: float, bit_ns: float, data_bit_ns: float) -> int | None:
    """Index of the bit that is on the wire so long after the start of frame; None after its end."""
    if not frame.flags & BITRATE_SWITCH:
        index = int(offset_ns // bit_ns)
        return index if index < frame_bits(frame).nominal else None
    end_ns = 0.0
    for index, bit in enumerate(frame_on_wire(frame)):  # noise is rare, so this is too
        end_ns += data_bit_ns if bit.is_fast else bit_ns
        if offset_ns < end_ns:
            return index
    return None
