"""The stuffed part of a classic frame as text, a byte at a time: start of frame to end of CRC.

The same bits as ``frame_on_wire`` lays out one by one, in a twentieth of the time.
"""

from functools import cache, lru_cache
from typing import NamedTuple

from .frame import EXTENDED, REMOTE, Frame
from .length import DATA_LENGTH_CODE, crc15


class StuffedText(NamedTuple):
    """One character a bit.

    ``levels``  0 dominant, 1 recessive
    ``stuff``   1 for a stuff bit
    """

    levels: str
    stuff: str


@lru_cache(maxsize=1024)
def stuffed_text(frame: Frame) -> StuffedText:
    """Return the bits of a classic frame up to the last one of its CRC, stuff bits included."""
    can_id, data, flags = frame
    rtr = 1 if flags & REMOTE else 0
    dlc = DATA_LENGTH_CODE[len(data)]
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
        part, marks, state = _stuffed(text[start : start + 8], state)
        levels.append(part)
        stuff.append(marks)
    return StuffedText("".join(levels), "".join(stuff))


@cache
def _stuffed(bits: str, state: int) -> tuple[str, str, int]:
    """Bits and marks, each stuff bit as soon as five equal bits are there, and the next state.

    ``state``  5 times the last bit before, plus the length of its run, less 1
    """
    last, run = str(state // 5), state % 5 + 1
    levels, marks = "", ""
    for bit in bits:
        run = run + 1 if bit == last else 1
        last, levels, marks = bit, levels + bit, marks + "0"
        if run == 5:
            last, run = ("1" if bit == "0" else "0"), 1
            levels, marks = levels + last, marks + "1"
    return levels, marks, int(last) * 5 + run - 1
