"""Noise on the wire: the instants at which a bit is seen wrong by every node, drawn from a seed.

The instants do not depend on the traffic, so that every law meets the same noise. Between them lie
exponential times: a bit of the nominal rate is hit with the probability that is the bit error rate.
In bursts, which come and go with exponential times too (Gilbert and Elliott), it has another rate.
"""

from random import Random
from typing import NamedTuple, Protocol

from ..node import NEVER_NS, NS_PER_S


class Noise(Protocol):
    """Says when bits are wrong."""

    def first_hit_ns(self, start_ns: int) -> int:
        """Return the first instant from ``start_ns`` on, NEVER_NS without any [ns]."""
        ...


class NoiseRates(NamedTuple):
    """How often bits are wrong.

    ``bit_error_rate``        share of the nominal bits that are wrong outside bursts
    ``burst_bit_error_rate``  share within bursts
    ``burst_interval_s``      mean time from the end of a burst to the next one [s]; 0 for no bursts
    ``burst_length_s``        mean length of a burst [s]
    """

    bit_error_rate: float
    burst_bit_error_rate: float = 0.0
    burst_interval_s: float = 0.0
    burst_length_s: float = 0.0


class BusNoise:
    """The instants in order.

    Raises ValueError for rates outside 0 to 0.5, and for bursts without a length or an interval.
    """

    def __init__(self, rates: NoiseRates, bitrate_bit_s: int, seed: int) -> None:
        bit_error_rates = (rates.bit_error_rate, rates.burst_bit_error_rate)
        has_bursts = rates.burst_bit_error_rate > 0
        if not all(0 <= rate <= 0.5 for rate in bit_error_rates):
            raise ValueError(f"bit error rates are 0 to 0.5, not {bit_error_rates}")
        if has_bursts and min(rates.burst_interval_s, rates.burst_length_s) <= 0:
            raise ValueError("bursts need an interval and a length above 0")
        self._hits_per_s = [rate * bitrate_bit_s for rate in bit_error_rates]
        self._mean_s = (rates.burst_interval_s, rates.burst_length_s)
        self._draw = Random(seed)  # noqa: S311 - reproducible, not secret
        self._is_burst = False
        self._state_end_ns = self._later_ns(0, rates.burst_interval_s) if has_bursts else NEVER_NS
        self._next_ns = self._hit_after(0)

    def first_hit_ns(self, start_ns: int) -> int:
        """Return the first instant from ``start_ns`` on, NEVER_NS without any [ns].

        ``start_ns`` must not run backwards from one call to the next.
        """
        while self._next_ns < start_ns:
            self._next_ns = self._hit_after(self._next_ns)
        return self._next_ns

    def _hit_after(self, now_ns: int) -> int:
        while True:
            hits_per_s = self._hits_per_s[self._is_burst]
            hit_ns = self._later_ns(now_ns, 1 / hits_per_s) if hits_per_s else NEVER_NS
            if hit_ns < self._state_end_ns or self._state_end_ns == NEVER_NS:
                return hit_ns
            now_ns, self._is_burst = self._state_end_ns, not self._is_burst
            self._state_end_ns = self._later_ns(now_ns, self._mean_s[self._is_burst])

    def _later_ns(self, now_ns: int, mean_s: float) -> int:
        return now_ns + 1 + int(self._draw.expovariate(1.0) * mean_s * NS_PER_S)
