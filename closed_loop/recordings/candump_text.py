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

from ...runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from ...runtime.node import NS_PER_S
from ...runtime.recording.candump import CAN_ERR_FLAG, CANFD_BRS
from .logged import Logged, logged

_COLOURS = re.compile("\x1b\\[[0-9;]*m")  # candump -c
_LOGGED = re.compile(
    r"""\(([0-9]{1,12}\.[0-9]{1,9})\)\s+(\S+)\s+      # time, channel
        ([0-9A-F]{3}|[0-9A-F]{8})\#                  # identifier
        (?: (R)[0-8]?(?:_[9A-F])?                    # remote frame, length asked for
          | \#([0-9A-F])((?:[0-9A-F]{2}){0,64})      # FD flags and payload
          | ((?:[0-9A-F]{2}){0,8})(?:_[9A-F])?       # payload, raw length code
        )(?:\s+[RT])?                                # direction (candump -x, python-can)
    """,
    re.ASCII | re.IGNORECASE | re.VERBOSE,
)
"""Without the requested length of a remote frame, the error state of an FD sender and a raw length
code above 8: a Frame has none of them."""
_PRINTED = re.compile(
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
        match = _LOGGED.fullmatch(line.strip())
        taken = _printed(line) if match is None else _logged(*match.groups())
        self._is_error = bool(taken.frame.flags & ERROR)
        return taken


def _logged(
    stamp: str, channel: str, identifier: str, remote: str, fd_flags: str, fd: str, payload: str
) -> Logged:
    """Return the frame of a line of ``candump -L``."""
    flags = REMOTE if remote else 0
    if fd_flags:
        flags = FD | (BITRATE_SWITCH if int(fd_flags, 16) & CANFD_BRS else 0)
    return _taken(stamp, channel, identifier, bytes.fromhex(fd or payload or ""), flags)


def _printed(line: str) -> Logged:
    """Read a line as candump prints it without -L; ValueError if it is no frame."""
    match = _PRINTED.fullmatch(line)
    if match is None:
        raise ValueError
    stamp, channel, identifier, length, code, remote, payload = match.groups()
    words = (payload or "").replace("`", " ").split()
    if len({len(word) for word in words}) > 1:  # bits of which the last are cut off
        raise ValueError
    data = bytes(int(word, 2 if len(word) == 8 else 16) for word in words)
    if "`" in (payload or ""):
        data = data[::-1]
    if not remote and len(data) != (int(length) if length else min(int(code, 16), 8)):
        raise ValueError
    flags = FD if length and len(length) == 2 else 0
    return _taken(stamp, channel, identifier, data, flags | (REMOTE if remote else 0))


def _taken(stamp: str | None, channel: str, identifier: str, data: bytes, flags: int) -> Logged:
    can_id = int(identifier, 16)
    if len(identifier) == 8:
        flags |= ERROR if can_id & CAN_ERR_FLAG else EXTENDED
        can_id &= ~CAN_ERR_FLAG
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
