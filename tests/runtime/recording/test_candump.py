import io

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.recordings.candump_text import CandumpReader
from steer_by_wire.closed_loop.recordings.logged import Logged
from steer_by_wire.runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from steer_by_wire.runtime.recording.candump import line_of

FD_LENGTHS = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64]


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    extended = draw(st.sampled_from([0, EXTENDED]))
    can_id = draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF))
    kind = draw(st.sampled_from([0, REMOTE, ERROR, FD, FD | BITRATE_SWITCH]))
    if kind == REMOTE:
        return Frame(can_id, b"", extended | REMOTE)
    if kind & FD:
        length = draw(st.sampled_from(FD_LENGTHS))
        return Frame(can_id, draw(st.binary(min_size=length, max_size=length)), extended | kind)
    data = draw(st.binary(max_size=8))
    if kind == ERROR:
        return Frame(draw(st.integers(0, 0x1FFFFFFF)), data, ERROR)
    return Frame(can_id, data, extended)


entries = st.builds(
    Logged,
    st.integers(0, 2**31 * 10**6).map(lambda microseconds: microseconds * 1000),
    st.sampled_from(["vcan0", "can1", "emulated:2"]),
    frames(),
)


@pytest.mark.parametrize(
    ("time_ns", "frame", "line"),
    [
        (0, Frame(0x100, bytes(range(8))), "(0000000000.000000) vcan0 100#0001020304050607"),
        (10**9 + 10_999, Frame(0x7FF, b"\xab"), "(0000000001.000010) vcan0 7FF#AB"),
        (0, Frame(0x1, b""), "(0000000000.000000) vcan0 001#"),
        (0, Frame(0x100, b"\0", EXTENDED), "(0000000000.000000) vcan0 00000100#00"),
        (0, Frame(0x123, b"", REMOTE), "(0000000000.000000) vcan0 123#R"),
        (0, Frame(0x123, b"\x11", FD), "(0000000000.000000) vcan0 123##011"),
        (0, Frame(0x123, b"\x11", FD | BITRATE_SWITCH), "(0000000000.000000) vcan0 123##111"),
        (0, Frame(0x040, bytes(2), ERROR), "(0000000000.000000) vcan0 20000040#0000"),
    ],
)
def test_lines_are_those_of_candump(time_ns: int, frame: Frame, line: str) -> None:
    assert line_of(time_ns, "vcan0", frame) == f"{line}\n"


@pytest.mark.parametrize(
    ("line", "frame"),
    [
        ("(1700000000.000001) can0 123#1122 R", Frame(0x123, b"\x11\x22")),
        ("(1700000000.000001)  can0  123#1122 T\n", Frame(0x123, b"\x11\x22")),
        ("(1700000000.000001000) can0 123#1122", Frame(0x123, b"\x11\x22")),
        ("(1700000000.000001) can0 123#R8", Frame(0x123, b"", REMOTE)),
        ("(1700000000.000001) can0 123#R8_C R", Frame(0x123, b"", REMOTE)),
        ("(1700000000.000001) can0 123#1122334455667788_F", Frame(0x123, b'\x11"3DUfw\x88')),
        ("(1700000000.000001) can0 00000123##5aAbB", Frame(0x123, b"\xaa\xbb", 1 | 8 | 16)),
        ("(1700000000.000001) can0 123##4", Frame(0x123, b"", FD)),
    ],
)
def test_lines_of_other_writers_are_read(line: str, frame: Frame) -> None:
    assert CandumpReader()(line) == Logged(1_700_000_000_000_001_000, "can0", frame)


@given(entries)
def test_what_is_written_is_read_back(entry: Logged) -> None:
    assert CandumpReader()(line_of(*entry)) == entry


@pytest.mark.parametrize(
    "line",
    [
        "(0.000001) can0 123#1",
        "(0.000001) can0 923#11",
        "(0.000001) can0 E0000123#11",
        "(0.000001) can0 123#112233445566778899",
        "(0.000001) can0 00123#81:00:12345678#11",
    ],
)
def test_a_line_that_is_no_frame_is_refused(line: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 most say no more than that
        CandumpReader()(line)


@given(st.lists(entries, max_size=10))
def test_python_can_reads_what_is_written(written: list[Logged]) -> None:
    # python-can knows error frames only by their bus-error bit (0x80), and not what is in them.
    written = [entry for entry in written if not entry.frame.flags & ERROR]
    text = "".join(line_of(*entry) for entry in written)
    messages = list(can.CanutilsLogReader(io.StringIO(text)))
    assert len(messages) == len(written)
    for (time_ns, channel, (can_id, data, flags)), message in zip(written, messages, strict=True):
        assert message.timestamp == pytest.approx(time_ns / 1e9, abs=1e-6)
        assert message.channel == channel
        assert message.arbitration_id == can_id
        assert bytes(message.data) == data
        assert message.is_extended_id == bool(flags & EXTENDED)
        assert message.is_remote_frame == bool(flags & REMOTE)
        assert message.is_fd == bool(flags & FD)
        assert message.bitrate_switch == bool(flags & BITRATE_SWITCH)
