"""Noise on the wire: the instants at which a bit is seen wrong by every node, drawn from a seed.

The instants do not depend on the traffic, so that every law meets the same noise. Between them lie
exponential times: a bit of the nominal rate is hit with the probability that is the bit error rate.
"""

from random import Random

from ..node import NEVER_NS, NS_PER_S


class BusNoise:
    """The instants in order; raises ValueError for a rate outside 0 to 0.5."""

    def __init__(self, bit_error_rate: float, bitrate_bit_s: int, seed: int) -> None:
        if not 0 <= bit_error_rate <= 0.5:
            raise ValueError(f"the bit error rate is 0 to 0.5, not {bit_error_rate}")
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
