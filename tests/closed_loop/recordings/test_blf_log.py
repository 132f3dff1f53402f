"""A .blf log is read object by object: each is a frame, or is counted, in bounded memory."""

import struct
import tracemalloc
import zlib
from pathlib import Path

import can
import pytest
from can.io import blf
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.recordings.blf_log import SIZE_MAX
from steer_by_wire.closed_loop.recordings.log_file import LogFile, open_log
from steer_by_wire.closed_loop.recordings.logged import LogError
from steer_by_wire.runtime.frame import ERROR

CONTAINER, COMMENT = 10, 65


def an_object(kind: int, content: bytes, size: int | None = None, header_size: int = 16) -> bytes:
    """An object of a .blf file: signature, sizes of the header and of all, type, content."""
    size = size or 16 + len(content)
    whole = struct.pack("<4sHHII", b"LOBJ", header_size, 1, size, kind) + content
    return whole + bytes(len(whole) % 4)


def a_container(unpacked: bytes) -> bytes:
    head = struct.pack("<H6xI4x", 2, len(unpacked))
    return an_object(CONTAINER, head + zlib.compress(unpacked, 1))


def a_log(path: Path, frames: int) -> Path:
    with can.BLFWriter(path) as writer:
        for number in range(frames):
            writer.on_message_received(can.Message(timestamp=0.01 * number, data=[number]))
    return path


def head(start: tuple[int, ...] = (0,) * 8) -> bytes:
    """The beginning of a file, with a size that is not known yet."""
    return blf.FILE_HEADER_STRUCT.pack(
        b"LOGG", 144, *(0,) * 8, 0, 0, 0, 0, *start, *(0,) * 8
    ).ljust(144, b"\0")


def a_frame(number: int, time_ns: int = 0, direction: int = 0, kind: int = 1) -> bytes:
    body = struct.pack("<HBBL8s", 1, direction, 8, number, bytes([number % 256] * 8))
    return an_object(kind, struct.pack("<LHHq", 2, 0, 0, time_ns) + body, header_size=32)


def read(path: Path, content: bytes) -> tuple[list[int], LogFile]:
    """Identifiers of the frames; an error frame has none."""
    path.write_bytes(content)
    log = open_log(path)
    return [one.frame.can_id for one in log if not one.frame.flags & ERROR], log


ENDLESS = an_object(COMMENT, bytes(1 << 20), 1 << 31)
BOMBS = {
    "a container: it unpacks to more than 16 MiB": a_container(bytes(4 * SIZE_MAX)),
    f"an object of type {COMMENT} is not {1 << 31} bytes long": (
        a_container(ENDLESS) + 63 * a_container(bytes(1 << 20))
    ),
}


@pytest.mark.parametrize("why", BOMBS)
@pytest.mark.parametrize("frames", [0, 3])
def test_what_unpacks_to_too_much_is_counted_in_bounded_memory(
    tmp_path: Path, why: str, frames: int
) -> None:
    path = a_log(tmp_path / "bomb.blf", frames)
    path.write_bytes(path.read_bytes() + BOMBS[why])
    log = open_log(path)
    tracemalloc.start()
    try:
        if frames:
            assert len(list(log)) == frames
            assert log.unreadable == 1
            assert why in log.first_unreadable
        else:
            with pytest.raises(LogError, match=why):
                list(log)
        assert tracemalloc.get_traced_memory()[1] < 4 * SIZE_MAX
    finally:
        tracemalloc.stop()


NUMBERS = list(range(1, 13))
ODD = {
    "size 0": struct.pack("<4sHHII", b"LOBJ", 16, 1, 0, 1) + bytes(32),
    "no object": bytes(50),
    "a size that covers the next": an_object(1, bytes(32), 96)[:48],
    "no frame": an_object(1, bytes(4)),
    "bytes in its size": a_frame(9)[:9] + b"FA0" + a_frame(9)[9:] + bytes(1),
}


@pytest.mark.parametrize("odd", ODD.values(), ids=ODD)
@pytest.mark.parametrize("is_packed", [False, True])
@given(place=st.integers(0, len(NUMBERS)))
def test_one_odd_object_costs_no_other_and_is_counted(
    tmp_path_factory: pytest.TempPathFactory, odd: bytes, is_packed: bool, place: int
) -> None:
    frames = [a_frame(number) for number in NUMBERS]
    content = b"".join([*frames[:place], odd, *frames[place:]])
    if is_packed:  # objects go on in the next container
        content = a_container(content[:100]) + a_container(content[100:])
    numbers, state = read(tmp_path_factory.mktemp("log") / "odd.blf", head() + content)
    assert numbers == NUMBERS
    assert state.unreadable == 1


@given(place=st.integers(0, 1 << 12), bit=st.integers(0, 7), removed=st.integers(0, 40))
def test_what_is_damaged_is_read_or_counted(
    tmp_path_factory: pytest.TempPathFactory, place: int, bit: int, removed: int
) -> None:
    content = b"".join(a_frame(number) for number in range(1, 60))
    whole = bytearray(content[:1440] + a_container(content[1440:]))
    place %= len(whole)
    whole[place] ^= 1 << bit
    del whole[place + 1 : place + 1 + removed]
    numbers, state = read(tmp_path_factory.mktemp("log") / "odd.blf", head() + whole)
    # Another type is none of a frame, and a request was not on the bus.
    assert len(numbers) == 59 or state.unreadable or place % 48 in (12, 13, 14, 15, 34)


def test_times_before_the_start_requests_and_error_frames(tmp_path: Path) -> None:
    start = (2026, 11, 6, 28, 9, 15, 2, 0)
    errors = b"".join(
        an_object(kind, bytes(16) + b"\1" + bytes(60), header_size=32) for kind in (2, 73, 104)
    )
    path = tmp_path / "log.blf"
    early, late = a_frame(1, -400_000_000), a_frame(2, 10_000_000)
    path.write_bytes(head(start) + early + late + a_frame(3, 0, direction=2) + errors)
    log = open_log(path)
    frames = list(log)
    assert [one.frame.can_id for one in frames[:2]] == [1, 2]
    assert [one.frame.flags for one in frames[2:]] == [ERROR] * 3
    times = [one.time_ns for one in frames[:2] if one.time_ns is not None]
    assert times[1] - times[0] == 410_000_000
    assert (log.unreadable, log.cut_off) == (0, "")
