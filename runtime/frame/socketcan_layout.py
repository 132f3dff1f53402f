"""A frame in the layout of Linux: ``struct can_frame`` and ``struct canfd_frame`` (linux/can.h).

So the kernel has it on SocketCAN; the emulated bus sends it too.
"""

from struct import Struct

from .frame import BITRATE_SWITCH, CLASSIC_LENGTH_MAX, ERROR, EXTENDED, FD, REMOTE, Frame

_EFF_FLAG, _RTR_FLAG, _ERR_FLAG = 0x8000_0000, 0x4000_0000, 0x2000_0000
_SFF_MASK, _EFF_MASK, _ERR_MASK = 0x7FF, 0x1FFF_FFFF, 0x1FFF_FFFF
_FD_BRS, _FD_MARK = 0x01, 0x04

CLASSIC_FRAME = Struct("=IB3x8s")
FD_FRAME = Struct("=IBB2x64s")
_FLAGS_AT = 5
"""Where a CAN FD frame has its flags, a classic one zero."""


def packed(frame: Frame) -> bytes:
    """Return ``frame`` as the kernel's ``struct can_frame`` or ``struct canfd_frame``.

    Raises ValueError for a payload that does not fit.
    """
    can_id, data, flags = frame
    if len(data) > (64 if flags & FD else CLASSIC_LENGTH_MAX):
        raise ValueError(f"{len(data)} bytes are too many for a frame")
    if flags:
        can_id |= (flags & EXTENDED and _EFF_FLAG) | (flags & REMOTE and _RTR_FLAG)
        can_id |= flags & ERROR and _ERR_FLAG
        if flags & FD:
            fd_flags = _FD_MARK | (_FD_BRS if flags & BITRATE_SWITCH else 0)
            return FD_FRAME.pack(can_id, len(data), fd_flags, data)
    return CLASSIC_FRAME.pack(can_id, len(data), data)


def unpacked(raw: bytes) -> Frame:
    """Return the frame of the kernel's structure."""
    flags = 0
    if len(raw) == CLASSIC_FRAME.size:
        can_id, length, data = CLASSIC_FRAME.unpack(raw)
    else:
        can_id, length, fd_flags, data = FD_FRAME.unpack(raw)
        flags = FD | (BITRATE_SWITCH if fd_flags & _FD_BRS else 0)
    if can_id <= _SFF_MASK:
        return Frame(can_id, data[:length], flags)
    if can_id & _ERR_FLAG:
        return Frame(can_id & _ERR_MASK, data[:length], flags | ERROR)
    if can_id & _RTR_FLAG:
        # Its length is the requested one; there is no payload.
        flags, length = flags | REMOTE, 0
    if can_id & _EFF_FLAG:
        return Frame(can_id & _EFF_MASK, data[:length], flags | EXTENDED)
    return Frame(can_id & _SFF_MASK, data[:length], flags)


def is_fd(raw: bytes) -> bool:
    """Whether the longer structure holds a CAN FD frame, as ``packed`` marks it."""
    return bool(raw[_FLAGS_AT] & _FD_MARK)
