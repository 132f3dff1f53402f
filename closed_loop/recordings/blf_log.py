"""A .blf log of Vector's tools or python-can: objects, most of them packed in containers.

Where objects make no sense, that counts once; reading goes on at the next, in bounded memory.
"""

import struct
import zlib
from collections.abc import Callable, Iterator
from typing import BinaryIO, Final

from can.io import blf
from can.util import dlc2len

from ...runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from ...runtime.node import NS_PER_S
from .logged import LogError, Logged, logged

SIZE_MAX = 1 << 24
"""Most that a container unpacks to, or that an object spans [bytes]; their writers pack 128 KiB."""
_READ_SIZE = 1 << 20
_BEGIN: Final = b"LOBJ"
_BASE = blf.OBJ_HEADER_BASE_STRUCT
_TIMES = struct.Struct("<L4xq")
"""Flags and time: before the start, in a recorder with a pre-trigger buffer, it is negative."""
PADDING_MAX = 8
_TIME_UNIT_NS = {blf.TIME_TEN_MICS: 10_000}
_ERROR_KINDS = {2, blf.CAN_ERROR_EXT, 104}
_CLASSIC_KINDS = {blf.CAN_MESSAGE, blf.CAN_MESSAGE2}
_FRAME_KINDS = {*_ERROR_KINDS, *_CLASSIC_KINDS, blf.CAN_FD_MESSAGE, blf.CAN_FD_MESSAGE_64}
_KIND_MAX = 255
"""The format's own go to about 140."""
REQUEST = 2
"""Direction of a request to send, which was not on the bus."""


class BlfReader:
    """Reads the frames of a .blf log.

    ``size``   of the file [bytes]
    ``count``  takes why something could not be read

    ``cut_off``  why something is missing at the end, once that is reached

    Raises LogError for a file without the header of the format.
    """

    def __init__(self, file: BinaryIO, size: int, count: Callable[[str], None]) -> None:
        self._file, self._size, self._count, self.cut_off = file, size, count, ""
        try:
            head = blf.FILE_HEADER_STRUCT.unpack(file.read(blf.FILE_HEADER_STRUCT.size))
            if head[0] != b"LOGG":
                raise ValueError
            self._start_ns = round(blf.systemtime_to_timestamp(head[14:22]) * NS_PER_S)
        except (struct.error, ValueError) as error:
            raise LogError("no .blf file: its header is damaged or missing") from error
        self._whole_size = head[10]
        file.seek(head[1])
        self._unpacked = _Objects(count)

    def frames(self) -> Iterator[Logged]:
        """Yield the frames."""
        packed = _Objects(self._count)
        while data := self._file.read(_READ_SIZE):
            for kind, content in packed.objects_in(data):
                yield from self._frames_in(kind, content)
        for kind, content in packed.end():
            yield from self._frames_in(kind, content)
        for kind, content in self._unpacked.end():
            yield from self._frame(kind, content)
        if packed.left or self._whole_size > self._size:
            self.cut_off = f"{self._size} of its {max(self._whole_size, self._size + 1)} bytes"

    def _frames_in(self, kind: int, content: bytes) -> Iterator[Logged]:
        """Yield the frames of an object of the file: many in a container, or its own."""
        if kind != blf.LOG_CONTAINER:
            yield from self._frame(kind, content)
            return
        unpacked, damage = _unpack(content[_BASE.size :])
        for inner in self._unpacked.objects_in(unpacked):
            yield from self._frame(*inner)
        if damage:
            self._count(f"{len(content)} bytes in a container: {damage}")
            for inner in self._unpacked.end():
                yield from self._frame(*inner)
            self._unpacked = _Objects(self._count, is_counted=True)

    def _frame(self, kind: int, content: bytes) -> Iterator[Logged]:
        if kind not in _FRAME_KINDS:
            if not 0 < kind <= _KIND_MAX:
                self._count(f"no object has the type {kind}")
            return
        try:
            taken = self._read(kind, content)
        except (ValueError, IndexError, struct.error):
            self._count(f"no frame: an object of type {kind}, {len(content)} bytes long")
        else:
            if taken is not None:
                yield taken

    def _read(self, kind: int, content: bytes) -> Logged | None:
        """Read an object; None for a request to send a frame."""
        _, _, version, _, _ = _BASE.unpack_from(content)
        flags, time = _TIMES.unpack_from(content, _BASE.size)
        time_ns = self._start_ns + time * _TIME_UNIT_NS.get(flags, 1)
        if version not in (1, 2):
            raise ValueError
        place = _BASE.size + (16 if version == 1 else 24)
        if kind in _ERROR_KINDS:
            return logged(time_ns, str(content[place] - 1), Frame(0, b"", ERROR))
        if kind == blf.CAN_FD_MESSAGE_64:
            channel, code, size, _, can_id, _, form, *_, direction, extra, _ = (
                blf.CAN_FD_MSG_64_STRUCT.unpack_from(content, place)
            )
            place += blf.CAN_FD_MSG_64_STRUCT.size
            # A sender may leave zeros at the end out.
            data = content[place : min(place + size, extra or len(content))].ljust(size, b"\0")
            is_remote, is_fd, is_switched = form & 0x10, form & 0x1000, form & 0x2000
        elif kind == blf.CAN_FD_MESSAGE:
            channel, bits, code, can_id, _, _, form, size, data = blf.CAN_FD_MSG_STRUCT.unpack_from(
                content, place
            )
            is_fd, is_switched = form & blf.EDL, form & blf.BRS
            direction, is_remote = bits & 0xF, bits & blf.REMOTE_FLAG
        else:
            channel, bits, code, can_id, data = blf.CAN_MSG_STRUCT.unpack_from(content, place)
            direction, is_remote, is_fd, is_switched = bits & 0xF, bits & blf.REMOTE_FLAG, 0, 0
            size = min(code, 8)
        if code > 15 or size > max(dlc2len(code), 8):
            raise ValueError
        if direction == REQUEST:
            return None
        kept = (EXTENDED if can_id & blf.CAN_MSG_EXT else 0) | (REMOTE if is_remote else 0)
        kept |= (FD if is_fd else 0) | (BITRATE_SWITCH if is_switched else 0)
        frame = Frame(can_id & ~blf.CAN_MSG_EXT, b"" if is_remote else data[:size], kept)
        return logged(time_ns, str(channel - 1), frame)


def _unpack(content: bytes) -> tuple[bytes, str]:
    """Return the objects in a container, as far as they can be unpacked, and what is wrong."""
    try:
        method, _ = blf.LOG_CONTAINER_STRUCT.unpack_from(content)
        packed = content[blf.LOG_CONTAINER_STRUCT.size :]
        if method == blf.NO_COMPRESSION:
            return packed, ""
        if method != blf.ZLIB_DEFLATE:
            return b"", f"compressed by an unknown method ({method})"
        unpacking = zlib.decompressobj()
        unpacked = unpacking.decompress(packed, SIZE_MAX + 1)
    except (struct.error, zlib.error):
        return b"", "damaged"
    if len(unpacked) > SIZE_MAX:
        return b"", f"it unpacks to more than {SIZE_MAX >> 20} MiB"
    return unpacked, "" if unpacking.eof else "damaged"


class _Objects:
    """Finds the objects in bytes that come in pieces; what is none between two of them counts once.

    ``left``  the beginning of one that is not there yet
    """

    def __init__(self, count: Callable[[str], None], *, is_counted: bool = False) -> None:
        """``is_counted``: the first bytes belong to an object that was counted as unreadable."""
        self._count, self._is_counted, self.left = count, is_counted, b""
        self._why = ""

    def objects_in(self, piece: bytes, *, is_end: bool = False) -> Iterator[tuple[int, bytes]]:
        """Yield type and bytes of each object that is complete with this piece of the file."""
        data, place = self.left + piece, 0
        while (begin := data.find(_BEGIN, place)) >= 0:
            self._lose(begin - place)
            place = begin
            if len(data) < begin + _BASE.size:
                break
            _, _, _, size, kind = _BASE.unpack_from(data, begin)
            end = begin + size
            inside = data.find(_BEGIN, begin + len(_BEGIN), end)
            is_odd = inside >= 0 and (kind != blf.LOG_CONTAINER or (is_end and len(data) < end))
            if is_odd or not _BASE.size <= size <= SIZE_MAX:
                self._why = self._why or f"an object of type {kind} is not {size} bytes long"
                place = begin + len(_BEGIN)
                continue
            follows = end + PADDING_MAX + len(_BEGIN)
            if len(data) < (end if is_end else follows):
                break
            if inside >= 0 and _BEGIN not in data[end:follows]:
                end = inside  # of a container that claims more than it has
            self._count_lost()
            yield kind, data[begin:end]
            place = end
        else:
            self._lose(len(data) - place)
            if len(data) > place + PADDING_MAX:
                place = len(data) - len(_BEGIN) + 1
            place = len(data) if is_end else place
        self.left = data[place:]

    def end(self) -> Iterator[tuple[int, bytes]]:
        """Yield what is there at the end; of a container that is cut off, its beginning."""
        yield from self.objects_in(b"", is_end=True)
        is_container = len(self.left) >= _BASE.size and (
            _BASE.unpack_from(self.left)[4] == blf.LOG_CONTAINER
        )
        if self.left and not is_container:
            self._why = self._why or "the last object has no end"
        self._count_lost()
        if is_container:
            yield blf.LOG_CONTAINER, self.left

    def _lose(self, size: int) -> None:
        if size > PADDING_MAX:
            self._why = self._why or f"no object begins in {size} bytes"

    def _count_lost(self) -> None:
        if self._why and not self._is_counted:
            self._count(self._why)
        self._why, self._is_counted = "", False
