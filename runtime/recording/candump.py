"""Log files in the format of ``candump -L`` (can-utils), which python-can and cantools read too.

    (0000000000.010000) vcan0 100#0011223344556677      classic, 11-bit identifier
    (0000000000.010000) vcan0 00000100#00               classic, 29-bit identifier
    (0000000000.010000) vcan0 100#R                     remote
    (0000000000.010000) vcan0 100##1001122              FD; the digit is 1 with bit rate switch
    (0000000000.010000) vcan0 20000040#0000000000000000 error frame

Times are truncated to microseconds. ``closed_loop.recordings.candump_text`` reads them.
"""

from pathlib import Path

from ..frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from ..output_file import open_text

# Bits of SocketCAN's can_id and canfd_frame.flags, as candump prints them (linux/can.h).
CAN_ERR_FLAG = 0x20000000
CANFD_BRS = 0x1


def line_of(time_ns: int, channel: str, frame: Frame) -> str:
    """Return a frame as one line; the epoch of its time [ns] is the writer's choice."""
    can_id, data, flags = frame
    seconds, microseconds = divmod(time_ns // 1000, 1_000_000)
    if flags & ERROR:
        identifier = f"{can_id | CAN_ERR_FLAG:08X}"
    else:
        identifier = f"{can_id:08X}" if flags & EXTENDED else f"{can_id:03X}"
    if flags & REMOTE:
        content = "R"
    elif flags & FD:
        content = f"#{CANFD_BRS if flags & BITRATE_SWITCH else 0:X}{data.hex().upper()}"
    else:
        content = data.hex().upper()
    return f"({seconds:010}.{microseconds:06}) {channel} {identifier}#{content}\n"


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
        self._file.write(line_of(time_ns, self._channel, frame))

    def close(self) -> None:
        """Flush and close the file."""
        self._file.close()
