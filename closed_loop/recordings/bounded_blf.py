"""A reader of .blf logs that unpacks no more at once than their writers pack.

A block of three megabytes may unpack to three gigabytes. Vector's tools and python-can pack
128 KiB at a time.
"""

import zlib
from collections.abc import Generator

import can
from can.io import blf

UNPACKED_BYTES_MAX = 1 << 24
"""Most that a block unpacks to, or that an object may span [bytes]."""


class BoundedBlfReader(can.BLFReader):
    """A reader of python-can that ends with ValueError where a block or an object is too large."""

    def __iter__(self) -> Generator[can.Message, None, None]:
        header = blf.OBJ_HEADER_BASE_STRUCT
        while packed := self.file.read(header.size):
            signature, _, _, size, kind = header.unpack(packed)
            if signature != b"LOBJ" or size < header.size:
                raise ValueError("no object where one should begin")
            content = self.file.read(size - header.size)
            self.file.read(size % 4)
            if kind == blf.LOG_CONTAINER:
                yield from self._parse_container(_unpacked(content))
                _check(len(self._tail))
        self.stop()


def _unpacked(content: bytes) -> bytes:
    """Return the objects in a block."""
    method, _ = blf.LOG_CONTAINER_STRUCT.unpack_from(content)
    packed = content[blf.LOG_CONTAINER_STRUCT.size :]
    if method != blf.ZLIB_DEFLATE:
        return packed
    unpacked = zlib.decompressobj().decompress(packed, UNPACKED_BYTES_MAX + 1)
    _check(len(unpacked))
    return unpacked


def _check(size: int) -> None:
    if size > UNPACKED_BYTES_MAX:
        raise ValueError(f"a block unpacks to more than {UNPACKED_BYTES_MAX >> 20} MiB")
