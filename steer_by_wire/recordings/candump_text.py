"""Reads the output of candump, whatever its options.

    (1436509052.249713) vcan0 044#2A366C2BBA      candump -L and -l, canplayer, python-can's .log
     (1436509052.249713)  vcan0  044   [5]  2A 36 6C 2B BA                candump -ta (-tz, -tA)
     (000.010000)  vcan0  RX - -  044   [5]  2A 36 6C 2B BA               candump -td -x
      vcan0  044   [5]  2A 36 6C 2B BA                                    candump: no times

A line that cannot be read is counted and skipped.
"""

import re
from collections.abc import Callable, Iterator
from datetime import datetime
from itertools import pairwise
from typing import NamedTuple

from ..runtime.candump import parse_entry
from ..runtime.frame import ERROR, EXTENDED, FD, REMOTE, Frame
from ..runtime.node import NS_PER_S
from .text_lines import TextLines

_HEAD_LINES = 200
"""Lines from which to decide whether candump's times are differences (-td)."""
_CAN_ERR_FLAG = 0x20000000
TIME_NS_LIMIT = 1 << 62
"""The year 2116: a later time is a misprint, and differences of times must fit into 64 bits."""
_CLOCK_STARTED_NS = 631_152_000 * NS_PER_S
"""1990: greater times are dates."""
_PLAIN = re.compile(
    r"""\s*(?:\(([^)]+)\)\s+)?              # time
        (\S+)\s+                             # channel
        (?:(?:RX|TX)\s+[B-]\s[E-]\s+)?       # candump -x
        ([0-9A-F]{3}|[0-9A-F]{8})\s+         # identifier
        \[(\d{1,2})\]                        # length; two digits for CAN FD
        (?:\s+(remote\ request)|((?:\s+[0-9A-F]{2})*))
        (?:\s+'.*'|\s+ERRORFRAME.*)?\s*      # candump -a; error frames
    """,
    re.ASCII | re.VERBOSE,
)


class Logged(NamedTuple):
    """A frame of a log; ``time_ns`` is None where the log has no times."""

    time_ns: int | None
    channel: str
    frame: Frame


def candump_frames(lines: TextLines) -> Iterator[Logged]:
    """Yield the frames of text that candump or python-can has printed."""
    head = [line for _, line in zip(range(_HEAD_LINES), lines, strict=False)]
    stamps = [match[1] for line in head if (match := _PLAIN.fullmatch(line)) and match[1]]
    lines.put_back(head)
    read_time = _distances() if _are_distances(stamps) else _time_ns
    for line in lines:
        entry = parse_entry(line)
        logged = _plain(line, read_time) if entry is None else Logged(*entry)
        if logged is not None and (logged.time_ns or 0) < TIME_NS_LIMIT:
            yield logged
        elif line.strip():
            lines.count_unreadable(f"no frame: {line.strip()[:60]!r}")


def _plain(line: str, read_time: Callable[[str], int | None]) -> Logged | None:
    """Read a line as candump prints it without -L; None if it is no frame."""
    match = _PLAIN.fullmatch(line)
    if match is None:
        return None
    stamp, channel, identifier, length, remote, payload = match.groups()
    data = bytes.fromhex(payload or "")
    can_id = int(identifier, 16)
    flags = FD if len(length) == 2 else 0
    if len(identifier) == 8:
        flags |= ERROR if can_id & _CAN_ERR_FLAG else EXTENDED
        can_id &= ~_CAN_ERR_FLAG
    flags |= REMOTE if remote else 0
    if not remote and len(data) != int(length):
        return None
    time_ns = read_time(stamp) if stamp else None
    if stamp and time_ns is None:
        return None
    return Logged(time_ns, channel, Frame(can_id, data, flags))


def _time_ns(stamp: str) -> int | None:
    """Read a time as candump -ta, -tz or -tA prints it [ns]."""
    seconds, _, fraction = stamp.partition(".")
    if not (fraction.isdecimal() and len(fraction) <= 9):
        return None
    if seconds.isdecimal():
        whole = int(seconds)
    else:
        try:
            whole = round(datetime.fromisoformat(seconds).timestamp())  # local, as candump's
        except ValueError:
            return None
    return whole * NS_PER_S + int(fraction.ljust(9, "0"))


def _are_distances(stamps: list[str]) -> bool:
    """Whether times are those of candump -td, not -tz: as times they would run backwards."""
    times = [time_ns for stamp in stamps if (time_ns := _time_ns(stamp)) is not None]
    if max(times, default=0) >= _CLOCK_STARTED_NS:
        return False
    # Differences fall as often as they rise; times hardly ever step back.
    backwards = sum(after < before for before, after in pairwise(times))
    return 10 * backwards > len(times)


def _distances() -> Callable[[str], int | None]:
    """Return a function that reads differences and adds them up."""
    now_ns = 0

    def read(stamp: str) -> int | None:
        nonlocal now_ns
        distance_ns = _time_ns(stamp)
        if distance_ns is None:
            return None
        now_ns += distance_ns
        return now_ns

    return read
