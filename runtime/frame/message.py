"""Frames as python-can's messages, and back."""

import can

from .frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame


def frame_of(message: can.Message) -> Frame:
    """Return the frame that a message holds; without time, channel and direction."""
    flags = EXTENDED * message.is_extended_id | REMOTE * message.is_remote_frame
    flags |= ERROR * message.is_error_frame | FD * message.is_fd
    flags |= BITRATE_SWITCH * message.bitrate_switch
    return Frame(message.arbitration_id, bytes(message.data), flags)


def message_of(frame: Frame) -> can.Message:
    """Return a message that holds ``frame``."""
    can_id, data, flags = frame
    return can.Message(
        arbitration_id=can_id,
        data=data,
        is_extended_id=bool(flags & EXTENDED),
        is_remote_frame=bool(flags & REMOTE),
        is_error_frame=bool(flags & ERROR),
        is_fd=bool(flags & FD),
        bitrate_switch=bool(flags & BITRATE_SWITCH),
    )
