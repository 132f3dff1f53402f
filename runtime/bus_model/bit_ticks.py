"""Time on a bus as integer ticks: the largest fraction of a nanosecond that divides its bit times.

Consecutive frames then add up without rounding.
"""

from math import gcd, lcm
from typing import NamedTuple

from ..frame import Frame
from ..frame.length_with_stuff_bits import frame_bits
from ..node import NS_PER_S


class BitTicks(NamedTuple):
    """Ticks in a nanosecond, and in a bit at the nominal and at the data bit rate."""

    per_ns: int
    nominal: int
    data: int

    def of_frame(self, frame: Frame) -> int:
        """Return how long a frame takes, start of frame to end of frame."""
        nominal_bits, data_bits = frame_bits(frame)
        return nominal_bits * self.nominal + data_bits * self.data

    def whole_ns(self, ticks: int) -> int:
        """Convert to nanoseconds, rounded up [ns]."""
        return -(-ticks // self.per_ns)


def bit_ticks(bitrate_bit_s: int, data_bitrate_bit_s: int) -> BitTicks:
    """Return the tick of a bus with these rates [bit/s].

    Raises ValueError for a rate that is not positive.
    """
    if bitrate_bit_s <= 0 or data_bitrate_bit_s <= 0:
        rates = f"{bitrate_bit_s} and {data_bitrate_bit_s} bit/s"
        raise ValueError(f"bit rates must be positive, not {rates}")
    per_ns = lcm(
        bitrate_bit_s // gcd(bitrate_bit_s, NS_PER_S),
        data_bitrate_bit_s // gcd(data_bitrate_bit_s, NS_PER_S),
    )
    per_s = NS_PER_S * per_ns
    return BitTicks(per_ns, per_s // bitrate_bit_s, per_s // data_bitrate_bit_s)
