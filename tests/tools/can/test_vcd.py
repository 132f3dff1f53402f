"""Waveforms of frames."""

from io import StringIO

import pytest

from steer_by_wire.runtime.frame import BITRATE_SWITCH, FD, Frame
from steer_by_wire.runtime.frame.wire_bits import frame_on_wire
from steer_by_wire.tools.can.waveform import BitRates, write_vcd

RATES = BitRates(500_000, 2_000_000)


def sampled(text: str, wire: str, times_ns: list[int]) -> list[int]:
    """The values of a wire at ascending times, as a viewer shows them."""
    changes, now_ns = [], 0
    for line in text.partition("$enddefinitions $end\n")[2].splitlines():
        if line.startswith("#"):
            now_ns = int(line[1:])
        elif line[1:] == wire:
            changes.append((now_ns, int(line[0])))
    return [[value for at_ns, value in changes if at_ns <= time_ns][-1] for time_ns in times_ns]


def test_each_bit_of_a_frame_is_there_for_its_time() -> None:
    frame, file = Frame(0x100, b"\x00\xff"), StringIO()
    assert write_vcd(file, [(123_456_789, frame)], RATES) == 0
    bits = frame_on_wire(frame)
    middles_ns = [2000 * index + 1000 for index in range(len(bits))]
    assert sampled(file.getvalue(), "c", middles_ns) == [bit.level for bit in bits]
    assert sampled(file.getvalue(), "s", middles_ns) == [int(bit.is_stuff) for bit in bits]


def test_the_data_phase_runs_at_its_own_rate() -> None:
    frame, file = Frame(0x100, bytes(8), FD | BITRATE_SWITCH), StringIO()
    write_vcd(file, [(0, frame)], RATES)
    middles_ns, start_ns = [], 0
    for bit in frame_on_wire(frame):
        bit_ns = 500 if bit.is_fast else 2000
        middles_ns.append(start_ns + bit_ns // 2)
        start_ns += bit_ns
    fast = [int(bit.is_fast) for bit in frame_on_wire(frame)]
    assert sampled(file.getvalue(), "f", middles_ns) == fast


@pytest.mark.parametrize(("gap_ns", "moved"), [(1_000_000, 0), (100_000, 1)])
def test_a_frame_that_comes_too_early_is_moved(gap_ns: int, moved: int) -> None:
    frame, file = Frame(0x100, bytes(8)), StringIO()
    assert write_vcd(file, [(0, frame), (gap_ns, frame)], RATES) == moved
    length = len(frame_on_wire(frame))
    start_ns = max(gap_ns, (length + 3) * 2000)
    assert sampled(file.getvalue(), "c", [start_ns - 1, start_ns + 1]) == [1, 0]
