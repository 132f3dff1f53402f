"""What a receiver makes of the bits it sees: a frame, or the error it finds and where.

Source: ISO 11898-1:2015, frame coding, error detection and frame acceptance.

    stuff error  a sixth equal bit where a stuff bit must be
    CRC error    another CRC, or another stuff count of an FD frame; found after the ACK delimiter
    form error   a dominant delimiter or end of frame, or a fixed stuff bit equal to its predecessor
    protocol exception   a recessive res bit of an FD frame: a later standard's format, no error

A receiver accepts a frame at the last but one bit of its end of frame. A dominant last bit is
therefore no error to it. To the sender it is one: it repeats the frame, which is received twice.
It accepts SRR, RRS, r1, r0 and ESI at either level, and in a classic frame a DLC above 8 as 8.
"""

from collections.abc import Iterable, Iterator
from enum import Enum
from typing import NamedTuple

from .frame import BITRATE_SWITCH, ERROR_STATE, EXTENDED, FD, REMOTE, REMOTE_LENGTH_SHIFT, Frame
from .length_with_stuff_bits import DATA_LENGTH_CODE
from .wire_bits import CRC_15, DOMINANT, RECESSIVE, RUN_MAX, crc_of, fd_crc, stuff_count

_BYTES_OF_DLC = {code: length for length, code in DATA_LENGTH_CODE.items()}
EOF_BITS = 7


class WireError(Enum):
    """What a receiver can find wrong."""

    STUFF = "stuff error"
    CRC = "CRC error"
    FORM = "form error"
    PROTOCOL_EXCEPTION = "protocol exception"
    INCOMPLETE = "the bits end within the frame"


class Reception(NamedTuple):
    """What became of one frame.

    ``frame``  what was accepted; None after an error
    ``error``  None for an accepted frame
    ``bit``    index of the bit at which this was decided, start of frame being 0
    """

    frame: Frame | None
    error: WireError | None
    bit: int


class _FoundError(Exception):
    """Ends the reception of a frame."""

    def __init__(self, error: WireError) -> None:
        super().__init__(error.value)
        self.error = error


def receive(levels: Iterable[int]) -> Reception:
    """Read one frame from its start of frame on; ``levels`` are as the receiver sampled them."""
    bits = _Bits(iter(levels))
    try:
        frame = _frame(bits)
    except _FoundError as found:
        return Reception(None, found.error, bits.index)
    return Reception(frame, None, bits.index)


class _Bits:
    """The bits after each other; with ``is_stuffed``, without the stuff bits, which are checked."""

    def __init__(self, levels: Iterator[int]) -> None:
        self._levels = levels
        self.index = -1
        self.is_stuffed = True
        self.last, self.run = RECESSIVE, 0
        self.stuff_bits = 0
        self.seen: list[int] = []
        self.kept: list[int] = []

    def raw(self) -> int:
        """The next bit on the wire."""
        level = next(self._levels, None)
        if level is None:
            raise _FoundError(WireError.INCOMPLETE)
        self.index += 1
        self.run = self.run + 1 if level == self.last else 1
        self.last = level
        self.seen.append(level)
        return level

    def one(self) -> int:
        """The next bit that is not a stuff bit."""
        if self.is_stuffed and self.run == RUN_MAX:
            self.remove_stuff_bit()
        level = self.raw()
        self.kept.append(level)
        return level

    def remove_stuff_bit(self) -> None:
        """Take the stuff bit that must follow five equal bits."""
        if self.raw() == self.kept[-1]:
            raise _FoundError(WireError.STUFF)
        self.stuff_bits += 1

    def number(self, width: int) -> int:
        """The next bits as a number, the first one most significant."""
        value = 0
        for _ in range(width):
            value = value << 1 | self.one()
        return value


def _frame(bits: _Bits) -> Frame:
    bits.one()  # start of frame
    can_id, flags = bits.number(11), 0
    remote = bits.one()
    ide = bits.one()
    if ide == RECESSIVE:
        can_id, flags = can_id << 18 | bits.number(18), EXTENDED
        remote = bits.one()
        format_bit = bits.one()  # r1 of a classic frame, FDF of an FD frame
    else:
        format_bit = bits.one()  # r0 of a classic frame
    if format_bit == RECESSIVE:
        return _fd_frame(bits, can_id, flags)
    if flags & EXTENDED:
        bits.one()  # r0
    return _classic_frame(bits, can_id, flags | (REMOTE if remote else 0))


def _classic_frame(bits: _Bits, can_id: int, flags: int) -> Frame:
    length = min(bits.number(4), 8)
    if flags & REMOTE:
        flags, length = flags | length << REMOTE_LENGTH_SHIFT, 0
    data = bytes(bits.number(8) for _ in range(length))
    expected = crc_of(CRC_15, bits.kept)
    is_right = bits.number(CRC_15.width) == expected
    if bits.run == RUN_MAX:
        bits.remove_stuff_bit()
    _end_of_frame(bits, is_right=is_right)
    return Frame(can_id, data, flags)


def _fd_frame(bits: _Bits, can_id: int, flags: int) -> Frame:
    if bits.one() == RECESSIVE:
        raise _FoundError(WireError.PROTOCOL_EXCEPTION)
    flags |= FD | (BITRATE_SWITCH if bits.one() else 0)
    flags |= ERROR_STATE if bits.one() else 0
    length = _BYTES_OF_DLC[bits.number(4)]
    data = bytes(bits.number(8) for _ in range(length))
    bits.is_stuffed = False
    covered = list(bits.seen)
    count_levels, crc_levels = _without_fixed_stuff_bits(bits, fd_crc(length).width)
    expected = _number(crc_levels) == crc_of(fd_crc(length), [*covered, *count_levels])
    is_right = expected and _number(count_levels) == stuff_count(bits.stuff_bits)
    _end_of_frame(bits, is_right=is_right)
    return Frame(can_id, data, flags)


def _without_fixed_stuff_bits(bits: _Bits, crc_width: int) -> tuple[list[int], list[int]]:
    """Stuff count (4 bits) and CRC."""
    levels: list[int] = []
    for index in range(4 + crc_width):
        if index % 4 == 0:
            before = bits.last
            if bits.raw() == before:
                raise _FoundError(WireError.FORM)
        levels.append(bits.raw())
    return levels[:4], levels[4:]


def _number(levels: Iterable[int]) -> int:
    return int("".join(map(str, levels)), 2)


def _end_of_frame(bits: _Bits, *, is_right: bool) -> None:
    """CRC delimiter to the last but one bit of the end of frame."""
    bits.is_stuffed = False
    _recessive(bits)
    bits.raw()  # acknowledge slot
    _recessive(bits)
    if not is_right:
        raise _FoundError(WireError.CRC)
    for _ in range(EOF_BITS - 1):
        _recessive(bits)


def _recessive(bits: _Bits) -> None:
    if bits.raw() == DOMINANT:
        raise _FoundError(WireError.FORM)
