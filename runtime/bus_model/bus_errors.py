"""Errors on the bus: noise destroys frames, their senders repeat them, and controllers count.

The model of one error, simpler than ISO 11898-1:2015 in that every node sees the wrong bit:

    wrong bit     destroys the frame that it falls into, so that no one receives that frame
    error frame   from the next bit on: 12 bits of error flags, as receivers may notice the sender's
                  six only at their end and then send theirs, and 8 bits of delimiter
    counter       of transmit errors (TEC): 8 more for the sender; 1 less for each whole frame
    bus-off       above 255: the sender takes no part for 128 times 11 recessive bits, the time on
                  an idle bus

Everyone but the sender receives. The counter of receive
errors and the pause of an error passive sender are not modelled.
"""

from collections import Counter
from collections.abc import Callable
from random import Random

from ..node import NEVER_NS, NS_PER_S
from .bit_ticks import BitTicks

ERROR_FRAME_BITS = 12 + 8
BUS_OFF_MIN = 256
_BUS_OFF_BITS = 128 * 11


class BusNoise:
    """The instants at which every node sees a bit wrong, in order, drawn from a seed.

    They do not depend on the traffic, so that every law meets the same noise. Between them lie
    exponential times: a bit of the nominal rate is hit with the probability that is the bit error
    rate.
    """

    def __init__(self, bit_error_rate: float, bitrate_bit_s: int, seed: int) -> None:
        self._hits_per_s = bit_error_rate * bitrate_bit_s
        self._draw = Random(seed)  # noqa: S311 - reproducible, not secret
        self._next_ns = self._hit_after(0)

    def first_hit_ns(self, start_ns: int) -> int:
        """Return the first instant from ``start_ns`` on, NEVER_NS without any [ns].

        ``start_ns`` must not run backwards from one call to the next.
        """
        while self._next_ns < start_ns:
            self._next_ns = self._hit_after(self._next_ns)
        return self._next_ns

    def _hit_after(self, now_ns: int) -> int:
        if not self._hits_per_s:
            return NEVER_NS
        mean_s = 1 / self._hits_per_s
        return now_ns + 1 + int(self._draw.expovariate(1.0) * mean_s * NS_PER_S)


class BusErrors:
    """What a BusModel asks about errors; one for each bus.

    ``next_hit_ns``  when the next bit is wrong from an instant on, as ``BusNoise.first_hit_ns``

    ``count``     destroyed transmissions; ``bus_offs`` those that led to bus-off
    """

    def __init__(self, next_hit_ns: Callable[[int], int]) -> None:
        self.next_hit_ns = next_hit_ns
        self._transmit_errors: Counter[int] = Counter()
        self._off_until_ticks: dict[int, int] = {}
        self.count = self.bus_offs = 0

    def is_off(self, node: int, now_ticks: int) -> bool:
        """Whether a node is in bus-off; lets it take part again when that is over."""
        until_ticks = self._off_until_ticks.get(node)
        if until_ticks is None or now_ticks < until_ticks:
            return until_ticks is not None
        del self._off_until_ticks[node], self._transmit_errors[node]
        return False

    def on_whole(self, sender: int) -> None:
        """Count a frame that was sent and received."""
        if self._transmit_errors[sender]:
            self._transmit_errors[sender] -= 1

    def on_destroyed(self, sender: int, end_ticks: int, ticks: BitTicks) -> bool:
        """Count a destroyed transmission; returns whether its sender is off now."""
        self.count += 1
        self._transmit_errors[sender] += 8
        is_off = self._transmit_errors[sender] >= BUS_OFF_MIN
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
