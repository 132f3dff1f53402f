"""A small .blf log does not unpack to more than memory holds."""

import struct
import tracemalloc
import zlib
from pathlib import Path

import can
import pytest

from steer_by_wire.closed_loop.recordings.bounded_blf import UNPACKED_BYTES_MAX
from steer_by_wire.closed_loop.recordings.log_file import LogError, open_log

CONTAINER, COMMENT = 10, 65


def an_object(kind: int, content: bytes, size: int | None = None) -> bytes:
    """An object of a .blf file: signature, sizes of the header and of all, type, content."""
    whole = struct.pack("<4sHHII", b"LOBJ", 16, 1, size or 16 + len(content), kind) + content
    return whole + bytes(len(whole) % 4)


def a_container(unpacked: bytes) -> bytes:
    head = struct.pack("<H6xI4x", 2, len(unpacked))
    return an_object(CONTAINER, head + zlib.compress(unpacked, 1))


def a_log(path: Path, frames: int) -> Path:
    with can.BLFWriter(path) as writer:
        for number in range(frames):
            writer.on_message_received(can.Message(timestamp=0.01 * number, data=[number]))
    return path


ENDLESS = an_object(COMMENT, bytes(1 << 20), 1 << 31)
BOMBS = {
    "in one block": a_container(bytes(4 * UNPACKED_BYTES_MAX)),
    "in an object that goes on": a_container(ENDLESS) + 63 * a_container(bytes(1 << 20)),
}


@pytest.mark.parametrize("bomb", BOMBS.values(), ids=BOMBS)
@pytest.mark.parametrize("frames", [0, 3])
def test_a_log_that_unpacks_to_too_much_ends_there_with_its_cause(
    tmp_path: Path, bomb: bytes, frames: int
) -> None:
    path = a_log(tmp_path / "bomb.blf", frames)
    path.write_bytes(path.read_bytes() + bomb)
    line = f"{path}: damaged after {frames} frames: a block unpacks to more than 16 MiB"
    log = open_log(path)
    tracemalloc.start()
    try:
        if frames:
            assert len(list(log)) == frames
            assert (log.state.unreadable, log.state.first_unreadable) == (1, line)
        else:
            with pytest.raises(LogError) as raised:
                list(log)
            assert str(raised.value) == line
        assert tracemalloc.get_traced_memory()[1] < 4 * UNPACKED_BYTES_MAX
    finally:
        tracemalloc.stop()
