"""Frames as a waveform: Value Change Dump (IEEE 1364-2005, 18), which GTKWave and sigrok open.

Three wires: ``can`` is the bus, 0 dominant; ``stuff_bit`` is 1 during stuff bits; ``fast`` is 1
where the data bit rate applies. The time scale is 1 ns, and edges are rounded to it.
"""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import NamedTuple, TextIO

from ...runtime.frame import Frame
from ...runtime.frame.exact_length import INTERMISSION_BITS
from ...runtime.frame.wire_bits import RECESSIVE, frame_on_wire
from ...runtime.node import NS_PER_S

_HEADER = """$timescale 1 ns $end
$scope module bus $end
$var wire 1 c can $end
$var wire 1 s stuff_bit $end
$var wire 1 f fast $end
$upscope $end
$enddefinitions $end
"""
_IDLE = (RECESSIVE, 0, 0)


class BitRates(NamedTuple):
    """Nominal rate, and the one of the data phase of FD frames that switch [bit/s]."""

    nominal_bit_s: int
    data_bit_s: int


def write_vcd(file: TextIO, frames: Iterable[tuple[int, Frame]], rates: BitRates) -> int:
    """Write frames with the times at which they end [ns], in order; returns how many were moved.

    On a bus without a bit rate, such as vcan, frames can be closer than they are long. Such a frame
    is moved behind the one before it and its intermission. The first one starts at time 0.
    """
    file.write(_HEADER)
    before = None
    origin_ns, free_ns, moved = None, 0, 0
    for end_ns, frame in frames:
        bits = list(_waveform(frame, rates))
        duration_ns = bits[-1][0]
        if origin_ns is None:
            origin_ns = end_ns - duration_ns
        start_ns = end_ns - duration_ns - origin_ns
        moved += start_ns < free_ns
        start_ns = max(start_ns, free_ns)
        for offset_ns, values in bits:
            if values != before:
                file.write(f"#{start_ns + offset_ns}\n" + _changes(before, values))
                before = values
        free_ns = start_ns + duration_ns + INTERMISSION_BITS * NS_PER_S // rates.nominal_bit_s
    file.write(f"#{free_ns}\n")
    return moved


def _waveform(frame: Frame, rates: BitRates) -> Iterator[tuple[int, tuple[int, int, int]]]:
    """Offset [ns] and values of each bit, and of the idle bus after the last one."""
    offset_ns = Fraction(0)
    for bit in frame_on_wire(frame):
        yield round(offset_ns), (bit.level, int(bit.is_stuff), int(bit.is_fast))
        offset_ns += Fraction(NS_PER_S, rates.data_bit_s if bit.is_fast else rates.nominal_bit_s)
    yield round(offset_ns), _IDLE


def _changes(before: tuple[int, int, int] | None, values: tuple[int, int, int]) -> str:
    return "".join(
        f"{value}{name}\n"
        for index, (name, value) in enumerate(zip("csf", values, strict=True))
        if before is None or before[index] != value
    )
