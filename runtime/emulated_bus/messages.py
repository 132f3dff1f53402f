"""python-can's messages as frames of the emulated bus, and back."""

import can

from ..frame import Frame
from ..message import frame_of, message_of
from .protocol import ERROR_STATE, FD_LENGTHS, OWN, REMOTE_LENGTH_SHIFT, ProtocolError, check_frame


def sent_frame(message: can.Message) -> Frame:
    """Return the frame to send, padded to a length that CAN FD has.

    Raises can.CanOperationError for an invalid frame.
    """
    frame = frame_of(message)
    if message.error_state_indicator:
        frame = frame._replace(flags=frame.flags | ERROR_STATE)
    if message.is_remote_frame:
        frame = frame._replace(flags=frame.flags | message.dlc << REMOTE_LENGTH_SHIFT)
    elif message.is_fd:
        # As SocketCAN does: CAN FD has no frame of nine bytes.
        size = len(frame.data)
        size = next((length for length in FD_LENGTHS if length >= size), size)
        frame = frame._replace(data=frame.data.ljust(size, b"\0"))
    try:
        check_frame(frame)
    except ProtocolError as error:
        raise can.CanOperationError(f"not a frame that can be sent: {error}") from error
    return frame


def received_message(frame: Frame, time_ns: int, channel: str) -> can.Message:
    """Return the message of a frame that ended at ``time_ns`` of the wall clock."""
    message = message_of(frame)
    message.timestamp = time_ns * 1e-9
    message.channel = channel
    message.is_rx = not frame.flags & OWN
    message.error_state_indicator = bool(frame.flags & ERROR_STATE)
    if message.is_remote_frame:
        message.dlc = frame.flags >> REMOTE_LENGTH_SHIFT
    return message
