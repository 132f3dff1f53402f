"""Exact length of a CAN frame on the wire [bits], stuff bits of its own content included.

Source: ISO 11898-1:2015, frame formats and frame coding. A frame extends from start of
frame to end of frame, without the intermission after it. A receiver acknowledges in time.

Bits before the payload, dominant 0, recessive 1:

    classic, 11 bit   SOF=0 id:11 RTR IDE=0 r0=0                                  dlc:4
    classic, 29 bit   SOF=0 base:11 SRR=1 IDE=1 extension:18 RTR r1=0 r0=0        dlc:4
    FD, 11 bit        SOF=0 id:11 RRS=0 IDE=0              FDF=1 res=0 BRS ESI    dlc:4
    FD, 29 bit        SOF=0 base:11 SRR=1 IDE=1 extension:18 RRS=0 FDF=1 res=0 BRS ESI dlc:4

After five equal bits the sender inserts an opposite one, which counts as the first of the next
five. In classic frames this applies up to the last bit of the CRC. In FD frames it ends with the
payload: the stuff count and the CRC have stuff bits at fixed positions, whatever their value.

Stuff bits and CRC are computed a byte at a time with tables, because every frame on the bus comes
through here. Bits before SOF fill up the first byte. They alternate and end recessive, as on an
idle bus, so they neither get a stuff bit nor lengthen a run.
"""

from functools import lru_cache
from typing import NamedTuple

from .frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame

INTERMISSION_BITS = 3
"""Recessive bits between two frames, at the nominal bit rate."""

DATA_LENGTH_CODE = {length: length for length in range(9)} | {
    12: 9, 16: 10, 20: 11, 24: 12, 32: 13, 48: 14, 64: 15
}  # fmt: skip
"""Data length code of each possible payload length [bytes]."""

_CLASSIC_CRC_BITS = 15
_CRC15_POLYNOMIAL = 0x4599
_CLASSIC_TRAILER_BITS = 1 + 2 + 7
"""CRC delimiter, acknowledge slot and delimiter, end of frame."""

_HEADER_BITS = 19
"""Start of frame to the data length code, with 11 bits of identifier."""
_BASE_ID_MAX = 0x7FF

_FD_UNTIL_BRS, _FD_UNTIL_BRS_EXTENDED = 17, 36
"""Start of frame to the bit that switches the rate."""
_ESI_AND_DLC_BITS = 1 + 4
_FD_TRAILER_BITS = 2 + 7
"""Acknowledge slot and delimiter, end of frame. The CRC delimiter belongs to the data phase."""
_FD_SHORT_MAX = 16
"""Longest payload with the 17-bit CRC [bytes]; longer ones have 21 bits."""
_FD_SHORT_CHECK_BITS = 4 + 17 + 6 + 1
"""Stuff count with parity, CRC, fixed stuff bits (in front and after every four), delimiter."""
_FD_LONG_CHECK_BITS = 4 + 21 + 7 + 1


def padded_length(length: int) -> int | None:
    """Return the least payload length of a frame with room for so many bytes; None above 64."""
    return min((fits for fits in DATA_LENGTH_CODE if fits >= length), default=None)


class FrameBits(NamedTuple):
    """Bits of one frame by their bit rate; ``data``: ESI to CRC delimiter, with BITRATE_SWITCH."""

    nominal: int
    data: int


def _crc15_table() -> tuple[int, ...]:
    """Remainder of each byte value under the classic CRC polynomial."""
    table = []
    for byte in range(256):
        remainder = byte << 7
        for _ in range(8):
            remainder <<= 1
            if remainder & 0x8000:
                remainder ^= 0x8000 | _CRC15_POLYNOMIAL
        table.append(remainder)
    return tuple(table)


_StuffRow = list[tuple["_StuffRow", int]]
"""For each byte value: the row to continue with, and the stuff bits inserted on the way."""


def _stuff_rows() -> list[_StuffRow]:
    """One row for each last bit and run length: the row of (bit, run) is at ``bit * 5 + run - 1``.

    A stuff bit is counted when the bit after it is sent, so that a run of five at the very end is
    still open: a classic frame adds the stuff bit there, an FD frame has its fixed one.
    """
    rows: list[_StuffRow] = [[] for _ in range(10)]
    # Equal entries are one object: few enough that a processor keeps them all at hand.
    entries = {
        (state, stuffed): (rows[state], stuffed) for state in range(10) for stuffed in range(3)
    }
    for state, row in enumerate(rows):
        for byte in range(256):
            last, run, stuffed = state // 5, state % 5 + 1, 0
            for shift in range(7, -1, -1):
                if run == 5:
                    last, run, stuffed = 1 - last, 1, stuffed + 1
                bit = byte >> shift & 1
                last, run = (last, run + 1) if bit == last else (bit, 1)
            row.append(entries[last * 5 + run - 1, stuffed])
    return rows


_CRC15_TABLE = _crc15_table()
_STUFF_ROWS = _stuff_rows()
_IDLE_ROW = _STUFF_ROWS[0]
"""Where counting begins. Every header starts with filling bits, so a run of one does not matter."""


def crc15(message: bytes, register: int = 0) -> int:
    """CRC of classic frames (CRC-15/CAN) over whole bytes, from the register's value before."""
    for byte in message:
        register = _CRC15_TABLE[register >> 7 ^ byte] ^ (register << 8 & 0x7FFF)
    return register


def _crc15_with_zeros(count: int) -> list[list[int]]:
    """CRC of each byte value with no zero byte after it, one, and so on: so many tables."""
    tables = [[_CRC15_TABLE[byte] for byte in range(256)]]
    while len(tables) < count:
        tables.append([_CRC15_TABLE[crc >> 7] ^ (crc << 8 & 0x7FFF) for crc in tables[-1]])
    return tables


_CRC_0, _CRC_1, _CRC_2, _CRC_3, _CRC_4, _CRC_5, _CRC_6, _CRC_7 = _crc15_with_zeros(8)


def _stuff_bits(bits: bytes) -> int:
    """Stuff bits inserted into ``bits``, without the one after a run of five at the end."""
    row, total = _IDLE_ROW, 0
    for byte in bits:
        row, stuffed = row[byte]
        total += stuffed
    return total


def frame_bits(frame: Frame) -> FrameBits:
    """Length of ``frame`` from start of frame to end of frame [bits].

    Raises ValueError for what cannot be sent as one frame: an error frame, an identifier or a
    payload too long for the format, a remote frame with a payload or with FD.
    """
    can_id, data, flags = frame
    if not flags and len(data) == 8:
        return FrameBits(bits_of_eight_bytes(can_id, data), 0)
    limit = 0x1FFFFFFF if flags & EXTENDED else _BASE_ID_MAX
    dlc = DATA_LENGTH_CODE.get(len(data))
    if not 0 <= can_id <= limit or dlc is None or flags & ERROR:
        raise ValueError(f"not a frame that can be sent: {frame}")
    if flags & FD:
        if flags & REMOTE:
            raise ValueError(f"CAN FD has no remote frames: {frame}")
        return _fd_bits(can_id, data, dlc, flags)
    if dlc > 8 or (flags & REMOTE and data) or flags & BITRATE_SWITCH:
        raise ValueError(f"not a classic frame: {frame}")
    return FrameBits(_classic_bits(can_id, data, dlc, flags), 0)


def _classic_bits(can_id: int, data: bytes, dlc: int, flags: int) -> int:
    register, row, total = _after_header(can_id, dlc, flags)
    for byte in data:
        register = _CRC15_TABLE[register >> 7 ^ byte] ^ (register << 8 & 0x7FFF)
        row, stuffed = row[byte]
        total += stuffed
    # The bit that fills up the last byte makes a run of five at the end of the CRC count.
    row, stuffed = row[register >> 7]
    total += stuffed + row[register << 1 & 0xFF][1]
    return total + 8 * len(data) + _CLASSIC_CRC_BITS + _CLASSIC_TRAILER_BITS


def bits_of_eight_bytes(can_id: int, data: bytes) -> int:
    """Length of the frame most sent, with 11 bits of identifier and 8 bytes: written out [bits].

    The CRC is linear: it is that of the header and zeros, and of each byte and the zeros after it.
    Raises ValueError for a longer identifier.
    """
    crc, row, bits = _before_eight_bytes(can_id)
    a, b, c, d, e, f, g, h = data
    crc ^= _CRC_7[a] ^ _CRC_6[b] ^ _CRC_5[c] ^ _CRC_4[d]
    crc ^= _CRC_3[e] ^ _CRC_2[f] ^ _CRC_1[g] ^ _CRC_0[h]
    row, in_a = row[a]
    row, in_b = row[b]
    row, in_c = row[c]
    row, in_d = row[d]
    row, in_e = row[e]
    row, in_f = row[f]
    row, in_g = row[g]
    row, in_h = row[h]
    row, in_crc = row[crc >> 7]
    bits += in_a + in_b + in_c + in_d + in_e + in_f + in_g + in_h + in_crc
    return bits + row[crc << 1 & 0xFF][1]


@lru_cache(maxsize=4096)
def _before_eight_bytes(can_id: int) -> tuple[int, _StuffRow, int]:
    """CRC of header and 8 zeros, row after the header, bits but the stuff bits to come."""
    if not 0 <= can_id <= _BASE_ID_MAX:
        raise ValueError(f"not a frame that can be sent: its identifier is {can_id:#x}")
    register, row, sent = _after_header(can_id, 8, 0)
    return crc15(bytes(8), register), row, sent + 64 + _CLASSIC_CRC_BITS + _CLASSIC_TRAILER_BITS


@lru_cache(maxsize=4096)
def _after_header(can_id: int, dlc: int, flags: int) -> tuple[int, _StuffRow, int]:
    """CRC register, row of the stuff bits and bits sent, after the header of a classic frame."""
    rtr = 1 if flags & REMOTE else 0
    # The register starts with what the filling bits clear to zero, so that they do not count.
    if flags & EXTENDED:
        total, register = 39, 0b1 << 14
        header = (1 << 39 | _extended_identifier(can_id) << 7 | rtr << 6 | dlc).to_bytes(5, "big")
    else:
        total, register = _HEADER_BITS, 0b10101 << 10
        header = (0b10101 << 19 | can_id << 7 | rtr << 6 | dlc).to_bytes(3, "big")
    row = _IDLE_ROW
    for byte in header:
        row, stuffed = row[byte]
        total += stuffed
    return crc15(header, register), row, total


def _fd_bits(can_id: int, data: bytes, dlc: int, flags: int) -> FrameBits:
    """Length of an FD frame [bits].

    The rate switches at the sample points of BRS and of the CRC delimiter; with both bit timings
    sampled at the same fraction of a bit that is one nominal and one data bit, as counted here.
    """
    brs = 1 if flags & BITRATE_SWITCH else 0
    # The last byte of the header is FDF, res, BRS, ESI, DLC.
    control = 1 << 7 | brs << 5
    if flags & EXTENDED:
        unstuffed_until_brs = _FD_UNTIL_BRS_EXTENDED
        head = 0b1010101 << 41 | _extended_identifier(can_id) << 9 | control
        header = head.to_bytes(6, "big")
    else:
        unstuffed_until_brs = _FD_UNTIL_BRS
        head = 0b01 << 22 | can_id << 10 | control
        header = head.to_bytes(3, "big")
    # Without ESI and DLC no run of five ends behind a recessive BRS, so what is counted up to there
    # was inserted before it.
    header_stuff = _stuff_bits(header)
    whole = header[:-1] + bytes([header[-1] | dlc]) + data
    payload_stuff = _stuff_bits(whole) - header_stuff
    until_brs = unstuffed_until_brs + header_stuff
    after_brs = _ESI_AND_DLC_BITS + 8 * len(data) + payload_stuff + _fd_check_bits(data)
    if brs:
        return FrameBits(until_brs + _FD_TRAILER_BITS, after_brs)
    return FrameBits(until_brs + after_brs + _FD_TRAILER_BITS, 0)


def most_frame_bits(frame: Frame) -> FrameBits:
    """Length that no payload of as many bytes makes ``frame`` exceed [bits].

    A stuff bit can follow the first five bits and then every four: n bits have at most (n - 1) / 4.
    """
    _, data, flags = frame
    if not flags & FD:
        header_bits = _HEADER_BITS + (20 if flags & EXTENDED else 0)
        stuffed = header_bits + 8 * len(data) + _CLASSIC_CRC_BITS
        return FrameBits(stuffed + (stuffed - 1) // 4 + _CLASSIC_TRAILER_BITS, 0)
    until_brs = _FD_UNTIL_BRS_EXTENDED if flags & EXTENDED else _FD_UNTIL_BRS
    stuffed = until_brs + _ESI_AND_DLC_BITS + 8 * len(data)
    whole = stuffed + (stuffed - 1) // 4 + _fd_check_bits(data)
    if not flags & BITRATE_SWITCH:
        return FrameBits(whole + _FD_TRAILER_BITS, 0)
    # The most at the nominal rate, whose bits are longer.
    slow = until_brs + (until_brs - 1) // 4
    return FrameBits(slow + _FD_TRAILER_BITS, whole - slow)


def _fd_check_bits(data: bytes) -> int:
    return _FD_SHORT_CHECK_BITS if len(data) <= _FD_SHORT_MAX else _FD_LONG_CHECK_BITS


def _extended_identifier(can_id: int) -> int:
    """Base identifier, SRR, IDE, identifier extension: the 31 bits after SOF."""
    return (can_id >> 18) << 20 | 0b11 << 18 | can_id & 0x3FFFF
