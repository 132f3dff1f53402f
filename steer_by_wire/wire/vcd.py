"""Frames as a waveform: Value Change Dump (IEEE 1364-2005, 18), which GTKWave and sigrok open.

Three wires: ``can`` is the bus, 0 dominant; ``stuff_bit`` is 1 during stuff bits; ``fast`` is 1
where the data bit rate applies. The time scale is 1 ns, and edges are rounded to it.
"""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import NamedTuple, TextIO

from ..runtime.frame import Frame
from .frame_on_wire import RECESSIVE, frame_on_wire

NS_PER_S = 1_000_000_000
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
    """Write frames with their starts [ns], in order; returns how many do not fit behind each other.

    A frame that starts before the one before it has ended is left out and counted.
    """
    file.write(_HEADER)
    before: tuple[int, int, int] | None = None
    end_ns, left_out = 0, 0
    file.write("#0\n" + _changes(before, _IDLE))
    before = _IDLE
    for start_ns, frame in frames:
        if start_ns < end_ns:
            left_out += 1
            continue
        for time_ns, values in _waveform(frame, start_ns, rates):
            if values != before:
                file.write(f"#{time_ns}\n" + _changes(before, values))
                before = values
            end_ns = time_ns
    file.write(f"#{end_ns + NS_PER_S * 11 // rates.nominal_bit_s}\n")
    return left_out


def _waveform(
    frame: Frame, start_ns: int, rates: BitRates
) -> Iterator[tuple[int, tuple[int, int, int]]]:
    """Start [ns] and values of each bit, and the idle bus after the last one."""
    offset_ns = Fraction(0)
    for bit in frame_on_wire(frame):
        yield start_ns + round(offset_ns), (bit.level, int(bit.is_stuff), int(bit.is_fast))
        offset_ns += Fraction(NS_PER_S, rates.data_bit_s if bit.is_fast else rates.nominal_bit_s)
    yield start_ns + round(offset_ns), _IDLE


def _changes(before: tuple[int, int, int] | None, values: tuple[int, int, int]) -> str:
    return "".join(
        f"{value}{name}\n"
        for index, (name, value) in enumerate(zip("csf", values, strict=True))
        if before is None or before[index] != value
    )
