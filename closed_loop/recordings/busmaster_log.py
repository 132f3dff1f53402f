"""Text that BUSMASTER logs: .log files that begin with ***BUSMASTER.

***HEX***                                                 or DEC, of identifiers and data
***SYSTEM MODE***                                         times of the day; see ``_MODES``
10:41:26:3860 Rx 1 0x110 s 8 99 78 00 00 00 00 00 00      hours to 0.1 ms, channel, type, DLC
"""

import re
from typing import Final

from can.util import dlc2len

from ...runtime.frame import EXTENDED, FD, REMOTE, Frame
from ...runtime.node import NS_PER_S
from .log_state import Logged, logged

BEGIN: Final = "***BUSMASTER"
_MODES = ("SYSTEM MODE", "ABSOLUTE MODE", "RELATIVE MODE")
"""Times of the day, since the start, and to the line before."""
_DAY_NS = 24 * 3600 * NS_PER_S
_LINE = re.compile(
    r"(\d+):(\d\d):(\d\d):(\d{4}) (?:Rx|Tx) (\w+) (0x[0-9A-F]+|\d+) ([sx]r?)(-?fd)? (\d+)"
    r"((?: [0-9A-F]+)*)\s*",
    re.ASCII | re.IGNORECASE,
)


class BusmasterReader:
    """Reads line by line."""

    def __init__(self) -> None:
        self._base, self._is_relative, self._now_ns = 16, False, 0

    def __call__(self, line: str) -> Logged | None:
        """Return the frame of a line, None where it has none; raises ValueError."""
        if line.startswith("***"):
            words = line.strip("* \r\n").upper()
            self._base = {"HEX": 16, "DEC": 10}.get(words, self._base)
            if words in _MODES:
                self._is_relative = words == _MODES[-1]
            return None
        if not line.strip():
            return None
        match = _LINE.fullmatch(line.rstrip())
        if match is None:
            raise ValueError
        hours, minutes, seconds, parts = (int(word) for word in match.groups()[:4])
        time_ns = (3600 * hours + 60 * minutes + seconds) * NS_PER_S + parts * NS_PER_S // 10_000
        if self._is_relative:
            time_ns += self._now_ns
        elif time_ns < self._now_ns - _DAY_NS // 2:  # past midnight
            time_ns += _DAY_NS * (1 + (self._now_ns - time_ns - _DAY_NS // 2) // _DAY_NS)
        channel, can_id, kind, fd, length, payload = match.groups()[4:]
        if self._base == 16 and any(len(word) != 2 for word in payload.split()):
            raise ValueError
        data = bytes(int(word, self._base) for word in payload.split())
        flags = (EXTENDED if kind[0] in "xX" else 0) | (FD if fd else 0)
        if kind[1:]:
            flags, data = flags | REMOTE, b""
        elif len(data) != (dlc2len(int(length)) if fd and int(length) < 16 else int(length)):
            raise ValueError
        taken = logged(time_ns, channel, Frame(int(can_id, self._base), data, flags))
        self._now_ns = time_ns
        return taken
