"""Log files in the format of ``candump -L`` (can-utils), which python-can and cantools read too.

    (0000000000.010000) vcan0 100#0011223344556677      classic, 11-bit identifier
    (0000000000.010000) vcan0 00000100#00               classic, 29-bit identifier
    (0000000000.010000) vcan0 100#R                     remote
    (0000000000.010000) vcan0 100##1001122              FD; the digit is 1 with bit rate switch
    (0000000000.010000) vcan0 20000040#0000000000000000 error frame

Times are truncated to microseconds on writing. On reading, the requested length of a remote frame,
the error state of an FD sender and a raw length code above 8 are ignored: a Frame has none of them.
"""

import re
from pathlib import Path
from typing import NamedTuple

from ..frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from ..output_file import open_text

# Bits of SocketCAN's can_id and canfd_frame.flags, as candump prints them (linux/can.h).
_CAN_ERR_FLAG = 0x20000000
_CANFD_BRS = 0x1

_LINE = re.compile(
    r"""\(([0-9]{1,12})\.([0-9]{1,9})\)\s+(\S+)\s+   # seconds, fraction, channel
        ([0-9A-F]{3}|[0-9A-F]{8})\#                  # identifier
        (?: (R)[0-8]?(?:_[9A-F])?                    # remote frame, length asked for
          | \#([0-9A-F])((?:[0-9A-F]{2}){0,64})      # FD flags and payload
          | ((?:[0-9A-F]{2}){0,8})(?:_[9A-F])?       # payload, raw length code
        )(?:\s+[RT])?                                # direction (candump -x, python-can)
    """,
    re.ASCII | re.IGNORECASE | re.VERBOSE,
)


class LogEntry(NamedTuple):
    """One line of a log; the epoch of its time [ns] is the writer's choice."""

    time_ns: int
    channel: str
    frame: Frame


def format_entry(entry: LogEntry) -> str:
    """Return the entry as one line, without line end."""
    time_ns, channel, (can_id, data, flags) = entry
    seconds, microseconds = divmod(time_ns // 1000, 1_000_000)
    if flags & ERROR:
        identifier = f"{can_id | _CAN_ERR_FLAG:08X}"
    else:
        identifier = f"{can_id:08X}" if flags & EXTENDED else f"{can_id:03X}"
    if flags & REMOTE:
        content = "R"
    elif flags & FD:
        content = f"#{_CANFD_BRS if flags & BITRATE_SWITCH else 0:X}{data.hex().upper()}"
    else:
        content = data.hex().upper()
    return f"({seconds:010}.{microseconds:06}) {channel} {identifier}#{content}"


def parse_entry(line: str) -> LogEntry | None:
    """Read one line; None if it is not a frame in this format."""
    match = _LINE.fullmatch(line.strip())
    if match is None:
        return None
    seconds, fraction, channel, identifier, remote, fd_flags, fd_payload, payload = match.groups()
    flags, can_id = 0, int(identifier, 16)
    if len(identifier) == 8:
        flags = ERROR if can_id & _CAN_ERR_FLAG else EXTENDED
        can_id &= ~_CAN_ERR_FLAG
    if can_id > (0x1FFFFFFF if flags else 0x7FF):
        return None
    if remote:
        flags |= REMOTE
    elif fd_flags:
        flags |= FD | (BITRATE_SWITCH if int(fd_flags, 16) & _CANFD_BRS else 0)
    time_ns = int(seconds) * 1_000_000_000 + int(fraction.ljust(9, "0"))
    return LogEntry(
        time_ns, channel, Frame(can_id, bytes.fromhex(fd_payload or payload or ""), flags)
    )


class CandumpLog:
    """Writes one log file. The same frames at the same times give the same bytes.

    ``path``     file to write, replaced if it exists; raises OSError
    ``channel``  name of the bus in the log, without blanks
    """

    def __init__(self, path: Path, channel: str) -> None:
        self._channel = channel
        self._file = open_text(path)

    def write(self, time_ns: int, frame: Frame) -> None:
        """Append a frame that was complete on the wire at ``time_ns``."""
        self._file.write(format_entry(LogEntry(time_ns, self._channel, frame)) + "\n")

    def close(self) -> None:
        """Flush and close the file."""
        self._file.close()

    def __enter__(self) -> "CandumpLog":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
