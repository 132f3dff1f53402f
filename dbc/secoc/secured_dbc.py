"""Prints the DBC of the authenticated frames, for tools that want all bytes of a frame described.

python -m steer_by_wire.dbc.secoc.secured_dbc > secured.dbc
candump vcan0 | cantools decode --single-line secured.dbc

It is ``steer_by_wire.dbc`` with longer messages: the bytes after the eighth, defined in
``dbc.secoc.secured_frame``, are signals of their own. What a tool sends is unchanged.
"""

import re
import sys
from pathlib import Path

from .secured_frame import DATA, LAYOUTS, LONG, SYNC, Layout

_TRAILERS = {
    DATA: (("MAC_COUNTER", 32), ("MAC", 64)),
    LONG: (("MAC_COUNTER", 32), ("MAC_HIGH", 64), ("MAC_LOW", 32)),
    SYNC: (("CHALLENGE", 64), ("ECHO", 64), ("MAC_COUNTER", 64), ("MAC_HIGH", 64), ("MAC_LOW", 64)),
}
"""The signals after the payload, without their message's name, and their bits: at most 64."""
_FD_FORMAT = 14
"""StandardCAN_FD in the list of formats that every tool knows by number."""
_MESSAGE = re.compile(r"^BO_ (\d+) (\w+): (?:8|48) (\w+)$((?:\n SG_ .*)+)", re.MULTILINE)


def secured_dbc() -> str:
    """Return the text of the DBC."""
    text = Path(__file__).parents[1].joinpath("steer_by_wire.dbc").read_text("ascii")
    text = _MESSAGE.sub(_longer, text)
    formats = {can_id: f'BA_ "VFrameFormat" BO_ {can_id} {_FD_FORMAT};\n' for can_id in LAYOUTS}
    values = "".join(line for line in formats.values() if line not in text)
    first_value = text.index("\nVAL_ ")
    return text[:first_value] + values + text[first_value:]


def _longer(found: re.Match[str]) -> str:
    """Return the definition of a message with the signals after its payload."""
    can_id, message, sender, signals = found.groups()
    layout = LAYOUTS[int(can_id)]
    trailer = _trailer(layout, message, receivers=signals.rpartition('" ')[2])
    return f"BO_ {can_id} {message}: {layout.length} {sender}{signals}{trailer}"


def _trailer(layout: Layout, message: str, receivers: str) -> str:
    """Return the lines of the signals after the payload, high byte first."""
    lines, start = "", 8 * layout.payload_length
    for name, bits in _TRAILERS[layout]:
        # In this byte order a DBC counts from the highest bit of the first byte.
        place = f"{start + 7}|{bits}@0+ (1,0) [0|{2**bits - 1}]"
        lines += f'\n SG_ {message}_{name} : {place} "" {receivers}'
        start += bits
    return lines


if __name__ == "__main__":
    sys.stdout.write(secured_dbc())
