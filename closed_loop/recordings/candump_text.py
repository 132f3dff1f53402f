"""Text that candump of can-utils prints, whatever its options; python-can's .log files too.

(1436509052.249713) vcan0 044#2A366C2BBA      candump -L and -l, canplayer, python-can's .log
 (1436509052.249713)  vcan0  044   [5]  2A 36 6C 2B BA                candump -ta (-tz, -tA)
 (1436509052.249713)  vcan0  RX - -  044   [5]  2A 36 6C 2B BA        candump -ta -x
  vcan0  044   [5]  2A 36 6C 2B BA                                    candump: no times
  vcan0  044   [5]  BA`2B`6C`36`2A                                    candump -S
  vcan0  044   [1]  00101010                                          candump -i
"""

import re
from datetime import datetime

from ...runtime.frame import ERROR, EXTENDED, FD, REMOTE, Frame
from ...runtime.node import NS_PER_S
from ...runtime.recording.candump import parse_entry
from .log_state import Logged, logged

_CAN_ERR_FLAG = 0x20000000
_COLOURS = re.compile("\x1b\\[[0-9;]*m")  # candump -c
_PLAIN = re.compile(
    r"""\s*(?:\(([^)]+)\)\s+)?              # time
        (\S+)\s+                             # channel
        (?:(?:RX|TX)\s+[B-]\s[E-]\s+)?       # candump -x
        ([0-9A-F]{3}|[0-9A-F]{8})\s+         # identifier
        (?:\[(\d{1,2})\]|\{([0-9A-F])\})     # length; two digits for CAN FD; candump -8
        (?:\s+(remote\ request)|((?:[\s`]+(?:[01]{8}|[0-9A-F]{2}))*))
        (?:\s+['`].*['`]|\s+ERRORFRAME.*)?\s*  # candump -a; error frames
    """,
    re.ASCII | re.VERBOSE,
)


class CandumpReader:
    """Reads lines of what candump has printed or logged."""

    def __init__(self) -> None:
        self._is_error = False

    def __call__(self, line: str) -> Logged | None:
        """Read a line: a frame, or None where it says none; raises ValueError."""
        line = _COLOURS.sub("", line)
        if not line.strip() or (self._is_error and line.startswith("\t")):  # words: candump -e
            return None
        entry = parse_entry(line)
        taken = _plain(line) if entry is None else logged(*entry)
        self._is_error = bool(taken.frame.flags & ERROR)
        return taken


def _plain(line: str) -> Logged:
    """Read a line as candump prints it without -L; ValueError if it is no frame."""
    match = _PLAIN.fullmatch(line)
    if match is None:
        raise ValueError
    stamp, channel, identifier, length, code, remote, payload = match.groups()
    words = (payload or "").replace("`", " ").split()
    if len({len(word) for word in words}) > 1:  # bits of which the last are cut off
        raise ValueError
    data = bytes(int(word, 2 if len(word) == 8 else 16) for word in words)
    if "`" in (payload or ""):
        data = data[::-1]
    can_id = int(identifier, 16)
    flags = FD if length and len(length) == 2 else 0
    if len(identifier) == 8:
        flags |= ERROR if can_id & _CAN_ERR_FLAG else EXTENDED
        can_id &= ~_CAN_ERR_FLAG
    flags |= REMOTE if remote else 0
    if not remote and len(data) != (int(length) if length else min(int(code, 16), 8)):
        raise ValueError
    return logged(_time_ns(stamp) if stamp else None, channel, Frame(can_id, data, flags))


def _time_ns(stamp: str) -> int:
    """Read a time as candump -ta, -tz or -tA prints it [ns]; ValueError."""
    seconds, _, fraction = stamp.partition(".")
    if not (fraction.isdecimal() and len(fraction) <= 9):
        raise ValueError
    is_count = seconds.isdecimal()
    # A date is local, as candump's.
    whole = int(seconds) if is_count else round(datetime.fromisoformat(seconds).timestamp())
    return whole * NS_PER_S + int(fraction.ljust(9, "0"))
