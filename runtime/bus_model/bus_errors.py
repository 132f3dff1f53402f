"""Errors on the bus: noise destroys frames, their senders repeat them, and controllers count.

The model of one error, simpler than ISO 11898-1:2015 in that every node sees the wrong bit:

    wrong bit     destroys the frame that it falls into, so that no one receives that frame
    error frame   from the next bit on: 12 bits of error flags, as receivers may notice the sender's
                  six only at their end and then send theirs, and 8 bits of delimiter
    counters      8 more for the sender, 1 for every other node; 1 less for each whole frame
    bus-off       above 255: the sender takes no part for 128 times 11 recessive bits, the time on
                  an idle bus

Which bit is wrong, ``bit_noise`` says. Everyone but the sender receives. The pause of an error
passive sender is not modelled.
"""

from collections.abc import Callable

from .bit_ticks import BitTicks

ERROR_FRAME_BITS = 12 + 8
PASSIVE_MIN, BUS_OFF_MIN = 128, 256
_BUS_OFF_BITS = 128 * 11
_RECEIVE_AFTER_PASSIVE = 120
"""What the receive counter falls to with the first good frame after error passive: 119 to 127."""


class ErrorCounters:
    """Transmit and receive error counter of one controller (TEC, REC)."""

    def __init__(self) -> None:
        self.transmit = self.receive = 0

    @property
    def is_off(self) -> bool:
        """Whether it is in bus-off."""
        return self.transmit >= BUS_OFF_MIN

    def on_error(self, *, is_own: bool) -> None:
        """Count an error of a frame; the receive counter does not grow while passive."""
        if is_own:
            self.transmit = min(self.transmit + 8, BUS_OFF_MIN)
        elif self.receive < PASSIVE_MIN:
            self.receive += 1

    def on_whole(self, *, is_own: bool) -> None:
        """Count a frame that came through."""
        if is_own:
            self.transmit = max(0, self.transmit - 1)
        elif self.receive >= PASSIVE_MIN:
            self.receive = _RECEIVE_AFTER_PASSIVE
        else:
            self.receive = max(0, self.receive - 1)


class BusErrors:
    """What a BusModel asks about errors; one for each bus.

    ``next_hit_ns``  when the next bit is wrong from an instant on, as ``BusNoise.first_hit_ns``

    ``count``     destroyed transmissions; ``bus_offs`` those that led to bus-off
    """

    def __init__(self, next_hit_ns: Callable[[int], int]) -> None:
        self.next_hit_ns = next_hit_ns
        self._counters: dict[int, ErrorCounters] = {}
        self._raised: set[int] = set()
        """Nodes whose counters are not 0."""
        self._off_until_ticks: dict[int, int] = {}
        self.count = self.bus_offs = 0

    def join(self, node: int) -> None:
        """Give this node counters."""
        self._counters.setdefault(node, ErrorCounters())

    def is_off(self, node: int, now_ticks: int) -> bool:
        """Whether a node is in bus-off; lets it take part again when that is over."""
        self.join(node)
        until_ticks = self._off_until_ticks.get(node)
        if until_ticks is None or now_ticks < until_ticks:
            return until_ticks is not None
        del self._off_until_ticks[node]
        self._counters[node] = ErrorCounters()
        return False

    def on_whole(self, sender: int) -> None:
        """Count a frame that was sent and received."""
        for node in tuple(self._raised):
            counters = self._counters[node]
            if not counters.is_off:
                counters.on_whole(is_own=node == sender)
            if not (counters.transmit or counters.receive):
                self._raised.discard(node)

    def on_destroyed(self, sender: int, end_ticks: int, ticks: BitTicks) -> bool:
        """Count a destroyed transmission; returns whether its sender is off now."""
        for node in tuple(self._off_until_ticks):
            self.is_off(node, end_ticks)
        for node, counters in self._counters.items():
            counters.on_error(is_own=node == sender)
        self._raised.update(self._counters)
        self.count += 1
        is_off = self._counters[sender].is_off
        if is_off:
            self.bus_offs += 1
            self._off_until_ticks[sender] = end_ticks + _BUS_OFF_BITS * ticks.nominal
        return is_off


def error_end_ticks(start_ticks: int, hit_ticks: int, ticks: BitTicks) -> int:
    """When a frame that starts at one instant and is hit at another leaves the bus.

    Data bits of CAN FD are shorter: there the wrong bit is taken for a nominal one.
    """
    bits = (hit_ticks - start_ticks) // ticks.nominal + 1 + ERROR_FRAME_BITS
    return start_ticks + bits * ticks.nominal
