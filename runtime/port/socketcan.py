"""SocketCAN by the standard library's ``AF_CAN``: a port that takes a third of python-can's time.

One system call sends a frame; one waits and one receives, and the Frame is the only object made.
Otherwise it behaves as python-can's ``socketcan``: error frames have the flag ERROR, CAN FD frames
are received on request only, and frames of other programs on this machine too, but not its own.

The kernel stamps each frame on arrival (SO_TIMESTAMPNS) with the wall clock. Setting the wall clock
can make arrivals wrong for up to a second; the executor limits them to between the last wake-up
and this one.
"""

import errno
import select
import socket
import struct
import time
from collections.abc import Sequence
from contextlib import suppress

from can.interfaces.socketcan.utils import pack_filters
from can.typechecking import CanFilter

from ..exit_status import BusError, cause_of
from ..frame import FD, Frame
from ..frame.socketcan_layout import FD_FRAME, packed, unpacked
from ..node import NS_PER_S
from ..node.real_time_loop import Received

# linux/can.h, linux/can/raw.h, asm-generic/socket.h; socket has most of them on Linux only
_AF_CAN, _CAN_RAW, _SOL_CAN_RAW = 29, 1, 101
_CAN_RAW_FILTER, _CAN_RAW_ERR_FILTER, _CAN_RAW_FD_FRAMES = 1, 2, 5
_SO_TIMESTAMPNS, _SO_RXQ_OVFL = 35, 40
_ERR_MASK = 0x1FFF_FFFF

_TIMESPEC = struct.Struct("@ll")
_COUNT = struct.Struct("=I")
_ANCILLARY_BYTES = 128
"""Room for a time stamp and a count of dropped frames, each with its header."""

_GONE = {
    errno.ENETDOWN: "is down",
    errno.ENODEV: "has been removed",
    errno.ENXIO: "has been removed",
}
_OFFSET_AGE_NS_MAX = NS_PER_S


class SocketCanPort:
    """One CAN network interface.

    ``filters``  in python-can's form; None: receives everything

    ``dropped``  frames for which the socket had no room, as of the last frame received

    Raises OSError if it cannot be opened, ValueError for invalid filters.
    """

    def __init__(
        self, channel: str, filters: Sequence[CanFilter] | None = None, *, fd: bool = False
    ) -> None:
        self._channel = channel
        self._clock = ArrivalClock()
        self.dropped = 0
        self._socket = socket.socket(_AF_CAN, socket.SOCK_RAW | socket.SOCK_NONBLOCK, _CAN_RAW)
        try:
            self._socket.setsockopt(_SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, _ERR_MASK)
            self._socket.setsockopt(_SOL_CAN_RAW, _CAN_RAW_FD_FRAMES, int(fd))
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            self.set_filters(filters)
            self._socket.bind((channel,))
        except BaseException:
            self._socket.close()
            raise

    def set_filters(self, filters: Sequence[CanFilter] | None) -> None:
        """Receive the frames that match ``filters``, and error frames; None: everything."""
        self._socket.setsockopt(_SOL_CAN_RAW, _CAN_RAW_FILTER, checked_filters(filters))

    def recv(self, timeout_s: float) -> Received | None:
        """Return the next frame, or None when none comes within ``timeout_s`` [s].

        Raises BusError when the interface is gone.
        """
        try:
            # Without waiting, one system call is enough.
            if timeout_s > 0.0 and not select.select([self._socket], [], [], timeout_s)[0]:
                return None
            raw, ancillary, _, _ = self._socket.recvmsg(FD_FRAME.size, _ANCILLARY_BYTES)
        except BlockingIOError:
            return None
        except (OSError, ValueError) as error:
            raise self._failed("receive", error) from error
        arrival_ns = None
        for level, kind, data in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS:
                seconds, nanoseconds = _TIMESPEC.unpack(data)
                arrival_ns = self._clock.monotonic_ns(seconds * NS_PER_S + nanoseconds)
            elif level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL:
                (self.dropped,) = _COUNT.unpack(data)
        return Received(unpacked(raw), arrival_ns)

    def send(self, frame: Frame) -> bool:
        """Send ``frame`` without waiting; returns whether the kernel's queue had room.

        Raises BusError when the interface is gone.
        """
        try:
            self._socket.send(packed(frame))
        except (OSError, ValueError) as error:
            code = error.errno if isinstance(error, OSError) else None
            if code in (errno.ENOBUFS, errno.EAGAIN):
                return False
            if code == errno.EINVAL and frame.flags & FD:
                what = f"the network interface {self._channel} carries classic frames only"
                raise BusError(f"cannot send: {what}, not CAN FD") from error
            raise self._failed("send", error) from error
        return True

    def shutdown(self) -> None:
        """Close the socket. Frames in the queue are still sent."""
        with suppress(OSError):
            self._socket.close()

    def _failed(self, what: str, error: Exception) -> BusError:
        code = error.errno if isinstance(error, OSError) else None
        if code in _GONE:
            return BusError(f"cannot {what}: the network interface {self._channel} {_GONE[code]}")
        return BusError(f"cannot {what}: {cause_of(error)}")


class ArrivalClock:
    """Converts the kernel's time stamps to the monotonic clock.

    The difference of the two clocks is read again when a stamp is a second after the last reading,
    or before it. The stamps themselves show how time passes, so that most frames need no reading.
    """

    def __init__(self) -> None:
        self._offset_ns = 0
        self._read_at_ns = -_OFFSET_AGE_NS_MAX - 1

    def monotonic_ns(self, wall_ns: int) -> int:
        """Return a recent wall-clock time on the monotonic clock [ns]."""
        if not 0 <= wall_ns - self._read_at_ns <= _OFFSET_AGE_NS_MAX:
            self._offset_ns = wall_minus_monotonic_ns()
            self._read_at_ns = wall_ns
        return wall_ns - self._offset_ns


_READING_NS_MAX = 200_000
"""Longest good reading of both clocks; User Mode Linux takes 75 µs."""


def wall_minus_monotonic_ns() -> int:
    """Return the difference of the clocks [ns], from the shortest of at least three readings.

    The error is half of the reading's time, so it reads again if all of them were interrupted.
    """
    readings: list[tuple[int, int]] = []
    while len(readings) < 3 or (min(readings)[0] > _READING_NS_MAX and len(readings) < 30):
        before_ns = time.monotonic_ns()
        wall_ns = time.time_ns()
        after_ns = time.monotonic_ns()
        readings.append((after_ns - before_ns, wall_ns - (before_ns + after_ns) // 2))
    return min(readings)[1]


def checked_filters(filters: Sequence[CanFilter] | None) -> bytes:
    """Return ``filters`` as the kernel takes them; raises ValueError for invalid ones."""
    try:
        return pack_filters(filters)
    except (KeyError, TypeError, struct.error) as error:  # from configuration files
        raise ValueError(f"{filters!r} is no list of {{can_id, can_mask}} of integers") from error
