"""The bits of a frame as they are on the wire, each with its field, stuff bits marked.

Source: ISO 11898-1:2015, frame formats and frame coding. A frame here is what one sender sends and
one receiver acknowledges, from start of frame to end of frame.

    classic   SOF ID (SRR IDE extension) RTR IDE/r1 r0 DLC data CRC:15
              | CRC delimiter ACK delimiter EOF:7
    FD        SOF ID (SRR IDE extension) RRS IDE FDF res BRS ESI DLC data
              | stuff count:3 parity CRC:17/21 CRC delimiter ACK delimiter EOF:7

Up to the bar a stuff bit follows every five equal bits. In FD frames the stuff count and the
CRC have fixed stuff bits, the complement of the bit before, in front and after every four bits.
The CRC of FD frames covers the stuff bits and the stuff count; it has 17 bits for up to 16 bytes.
"""

from collections.abc import Iterable, Iterator
from functools import cache, lru_cache
from typing import NamedTuple

from .frame import BITRATE_SWITCH, ERROR_STATE, EXTENDED, FD, REMOTE, REMOTE_LENGTH_SHIFT, Frame
from .length_with_stuff_bits import DATA_LENGTH_CODE, crc15, frame_bits

DOMINANT, RECESSIVE = 0, 1
RUN_MAX = 5
"""Equal bits after which a stuff bit follows."""


class WireBit(NamedTuple):
    """One bit on the wire.

    ``level``     0 dominant, 1 recessive
    ``field``     name of its field in the standard
    ``is_stuff``  inserted by the sender and removed by the receiver
    ``is_fast``   sent at the data bit rate
    """

    level: int
    field: str
    is_stuff: bool = False
    is_fast: bool = False


_TRAILER = (
    WireBit(DOMINANT, "ACK"),
    WireBit(RECESSIVE, "ACK delimiter"),
    *[WireBit(RECESSIVE, "EOF")] * 7,
)
"""In the acknowledge slot a receiver is dominant."""


class Crc(NamedTuple):
    """A cyclic redundancy check.

    ``width``       bits of the remainder
    ``polynomial``  without its first term
    ``start``       value of the register before the first bit
    """

    width: int
    polynomial: int
    start: int


CRC_15 = Crc(15, 0x4599, 0)
CRC_17 = Crc(17, 0x1685B, 1 << 16)
CRC_21 = Crc(21, 0x102899, 1 << 20)
CRC_17_PAYLOAD_MAX = 16
"""Longest payload with 17 bits of CRC [bytes]."""


def crc_of(crc: Crc, levels: Iterable[int]) -> int:
    """Remainder of a sequence of bits, first bit first."""
    register = crc.start
    top, mask = crc.width - 1, (1 << crc.width) - 1
    for level in levels:
        feedback = level ^ register >> top
        register = (register << 1 & mask) ^ (crc.polynomial if feedback else 0)
    return register


def fd_crc(payload_bytes: int) -> Crc:
    """CRC of an FD frame with this payload [bytes]."""
    return CRC_17 if payload_bytes <= CRC_17_PAYLOAD_MAX else CRC_21


def stuff_count(stuff_bits: int) -> int:
    """Four bits that report the dynamic stuff bits of an FD frame: modulo 8, Gray code, parity."""
    gray = stuff_bits % 8 ^ stuff_bits % 8 >> 1
    return gray << 1 | gray.bit_count() % 2


@lru_cache(maxsize=256)
def frame_on_wire(frame: Frame) -> tuple[WireBit, ...]:
    """Return the bits of ``frame``, start of frame first.

    Raises ValueError for what cannot be sent as one frame, as ``frame_bits`` does.
    """
    frame_bits(frame)
    if frame.flags & FD:
        return _fd_bits(frame)
    head = [*_identifier(frame), *_classic_control(frame), *_payload(frame)]
    crc = crc_of(CRC_15, (bit.level for bit in head))
    checked = [*head, *_bits("CRC", crc, CRC_15.width)]
    return (*_stuffed(checked, is_at_end=True), WireBit(RECESSIVE, "CRC delimiter"), *_TRAILER)


def _identifier(frame: Frame) -> list[WireBit]:
    """Start of frame to the bit before the control field's first format bit."""
    rtr = "RRS" if frame.flags & FD else "RTR"
    remote = 1 if frame.flags & REMOTE else 0
    is_extended = frame.flags & EXTENDED
    base = _bits("ID", frame.can_id >> 18 if is_extended else frame.can_id, 11)
    if is_extended:
        base += [WireBit(RECESSIVE, "SRR"), WireBit(RECESSIVE, "IDE")]
        base += _bits("ID extension", frame.can_id & 0x3FFFF, 18)
    return [WireBit(DOMINANT, "SOF"), *base, WireBit(remote, rtr)]


def _classic_control(frame: Frame) -> list[WireBit]:
    first = "r1" if frame.flags & EXTENDED else "IDE"
    dlc = _classic_dlc(frame)
    return [WireBit(DOMINANT, first), WireBit(DOMINANT, "r0"), *_bits("DLC", dlc, 4)]


def _classic_dlc(frame: Frame) -> int:
    """Length of the payload, or that a remote frame asks for."""
    flags = frame.flags
    return flags >> REMOTE_LENGTH_SHIFT if flags & REMOTE else len(frame.data)


def _payload(frame: Frame) -> list[WireBit]:
    return [bit for byte in frame.data for bit in _bits("data", byte, 8)]


def _fd_bits(frame: Frame) -> tuple[WireBit, ...]:
    switch = 1 if frame.flags & BITRATE_SWITCH else 0
    ide = [] if frame.flags & EXTENDED else [WireBit(DOMINANT, "IDE")]
    control = [WireBit(RECESSIVE, "FDF"), WireBit(DOMINANT, "res"), WireBit(switch, "BRS")]
    error_state = RECESSIVE if frame.flags & ERROR_STATE else DOMINANT
    length = [WireBit(error_state, "ESI"), *_bits("DLC", DATA_LENGTH_CODE[len(frame.data)], 4)]
    head = [*_identifier(frame), *ide, *control, *length, *_payload(frame)]
    stuffed = list(_stuffed(head, is_at_end=False))
    count = _bits("stuff count", stuff_count(len(stuffed) - len(head)), 4)
    crc = fd_crc(len(frame.data))
    remainder = crc_of(crc, (bit.level for bit in [*stuffed, *count]))
    check = _with_fixed_stuff_bits(stuffed[-1].level, [*count, *_bits("CRC", remainder, crc.width)])
    whole = [*stuffed, *check, WireBit(RECESSIVE, "CRC delimiter")]
    if switch:
        # The rate switches at the sample points of BRS and of the CRC delimiter: see length.py.
        first = next(index for index, bit in enumerate(whole) if bit.field == "ESI")
        whole[first:] = [bit._replace(is_fast=True) for bit in whole[first:]]
    return (*whole, *_TRAILER)


def _bits(field: str, value: int, width: int) -> list[WireBit]:
    return [WireBit(value >> shift & 1, field) for shift in range(width - 1, -1, -1)]


def _stuffed(bits: list[WireBit], *, is_at_end: bool) -> Iterator[WireBit]:
    """The bits with stuff bits; one after the last bit only with ``is_at_end``."""
    last, run = RECESSIVE, 0
    for index, bit in enumerate(bits):
        last, run = (last, run + 1) if bit.level == last else (bit.level, 1)
        yield bit
        if run == RUN_MAX and (is_at_end or index + 1 < len(bits)):
            last, run = 1 - last, 1
            yield WireBit(last, bit.field, is_stuff=True)


def _with_fixed_stuff_bits(last: int, bits: list[WireBit]) -> Iterator[WireBit]:
    """The bits with the complement of the one before them in front and after every four."""
    for index, bit in enumerate(bits):
        if index % 4 == 0:
            yield WireBit(1 - last, bit.field, is_stuff=True)
        last = bit.level
        yield bit


class StuffedText(NamedTuple):
    """The stuffed part of a classic frame, one character a bit.

    ``levels``  0 dominant, 1 recessive
    ``stuff``   1 for a stuff bit
    """

    levels: str
    stuff: str


@lru_cache(maxsize=1024)
def stuffed_text(frame: Frame) -> StuffedText:
    """Return the bits of a classic frame from start of frame to the end of its CRC.

    The same bits as ``frame_on_wire`` lays out one by one, in a twentieth of the time.
    """
    can_id, data, flags = frame
    rtr = 1 if flags & REMOTE else 0
    dlc = _classic_dlc(frame)
    if flags & EXTENDED:
        base, extension = can_id >> 18, can_id & 0x3FFFF
        head, width = base << 27 | 0b11 << 25 | extension << 7 | rtr << 6 | dlc, 39
    else:
        head, width = can_id << 7 | rtr << 6 | dlc, 19
    bits, width = head << 8 * len(data) | int.from_bytes(data, "big"), width + 8 * len(data)
    crc = crc15(bits.to_bytes(-(-width // 8), "big"))
    text = f"{bits:0{width}b}{crc:015b}"
    levels, stuff, state = [], [], 5
    for start in range(0, len(text), 8):
        part, marks, state = _stuffed_byte(text[start : start + 8], state)
        levels.append(part)
        stuff.append(marks)
    return StuffedText("".join(levels), "".join(stuff))


@cache
def _stuffed_byte(bits: str, state: int) -> tuple[str, str, int]:
    """Bits and marks, each stuff bit as soon as five equal bits are there, and the next state.

    ``state``  5 times the last bit before, plus the length of its run, less 1
    """
    last, run = str(state // 5), state % 5 + 1
    levels, marks = "", ""
    for bit in bits:
        run = run + 1 if bit == last else 1
        last, levels, marks = bit, levels + bit, marks + "0"
        if run == RUN_MAX:
            last, run = ("1" if bit == "0" else "0"), 1
            levels, marks = levels + last, marks + "1"
    return levels, marks, int(last) * 5 + run - 1
