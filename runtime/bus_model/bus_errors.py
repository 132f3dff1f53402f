"""Errors on the bus: noise destroys frames, their senders repeat them, and controllers count.

The model of one error, simpler than ISO 11898-1:2015 in that every node sees the wrong bit:

    wrong bit     destroys the frame that it falls into, so that no one receives that frame
    error frame   from the next bit on: 12 bits of error flags, as receivers may notice the sender's
                  six only at their end and then send theirs, and 8 bits of delimiter
    counters      8 more for the sender, 1 for every other node (``fault_confinement``)

Which bit is wrong, ``bit_noise`` says. Everyone but the sender receives: each other node has a
receive counter.
"""

from collections.abc import Callable

from .bit_noise import Noise
from .bit_ticks import BitTicks
from .fault_confinement import BUS_OFF_MIN, ErrorCounters

ERROR_FRAME_BITS = 12 + 8


class _Member:
    """A node on the bus: its counters, which lag behind the frames that came through."""

    def __init__(self) -> None:
        self.counters = ErrorCounters()
        self.own_frames = self.all_frames = 0


class BusErrors:
    """What a BusModel asks about errors; one for each bus.

    ``noise``     when bits are wrong
    ``on_error``  called for every destroyed transmission: its end [ns], its sender

    ``is_calm``   all nodes are error active
    ``sent``      complete frames by sender that has joined; its model counts them here or by
                  ``on_whole``
    ``count``     destroyed transmissions; ``bus_offs`` those that led to bus-off
    """

    def __init__(self, noise: Noise, on_error: Callable[[int, int], None] | None = None) -> None:
        self.next_hit_ns = noise.first_hit_ns
        self.on_error = on_error
        self._members: dict[int, _Member] = {}
        self._limited: set[int] = set()
        self.is_calm = True
        self.sent: dict[int, int] = {}
        self.count = self.bus_offs = 0

    def join(self, node: int) -> None:
        """Give this node counters."""
        if node not in self._members:
            member = self._members[node] = _Member()
            member.all_frames = self._all_frames
            self.sent[node] = 0

    def counters(self, node: int) -> ErrorCounters:
        """Return a node's counters as they are now."""
        return self._up_to_date(node, self._all_frames).counters

    def is_passive(self, node: int) -> bool:
        """Whether a node must pause after its frames."""
        return node in self._limited and self.counters(node).is_passive

    def is_off(self, node: int) -> bool:
        """Whether a node takes no part."""
        return node in self._limited and self._members[node].counters.is_off

    def restart(self, node: int) -> None:
        """Let a node take part again."""
        self.counters(node).restart()
        self._note_limits(node)

    def on_whole(self, sender: int) -> None:
        """Count a frame that was sent and received."""
        self.sent[sender] += 1
        if not self.is_calm:
            for node in tuple(self._limited):
                self._note_limits(node)

    def on_destroyed(self, sender: int, time_ns: int) -> None:
        """Count a destroyed transmission and report it."""
        total = self._all_frames
        for node in self._members:
            counters = self._up_to_date(node, total).counters
            if node == sender:
                counters.on_transmit_error()
            else:
                counters.on_receive_error()
            if counters.is_passive or node in self._limited:
                self._note_limits(node)
        self.count += 1
        self.bus_offs += self.is_off(sender)
        if self.on_error is not None:
            self.on_error(time_ns, sender)

    def _note_limits(self, node: int) -> None:
        if self.counters(node).is_passive:
            self._limited.add(node)
        else:
            self._limited.discard(node)
        self.is_calm = not self._limited

    @property
    def _all_frames(self) -> int:
        return sum(self.sent.values())

    def _up_to_date(self, node: int, total: int) -> _Member:
        """Let the counters of a node see the frames that have come through since last time."""
        member = self._members[node]
        own = self.sent[node]
        new_own = own - member.own_frames
        new_others = total - member.all_frames - new_own
        member.own_frames, member.all_frames = own, total
        if member.counters.transmit < BUS_OFF_MIN:
            member.counters.on_sent(new_own)
            member.counters.on_received(new_others)
        return member


def error_end_ticks(start_ticks: int, hit_ticks: int, ticks: BitTicks) -> int:
    """When a frame that starts at one instant and is hit at another leaves the bus.

    Data bits of CAN FD are shorter: there the wrong bit is taken for a nominal one.
    """
    bits = (hit_ticks - start_ticks) // ticks.nominal + 1 + ERROR_FRAME_BITS
    return start_ticks + bits * ticks.nominal
