"""A frame of a log, checked, and the errors of reading one."""

from typing import NamedTuple

from ...runtime.frame import ERROR, EXTENDED, FD, Frame
from ...runtime.settings import SettingsError

TIME_NS_LIMIT = 1 << 62
"""The year 2116: a later time is a misprint, and differences of times must fit into 64 bits."""


class LogError(SettingsError):
    """A log that cannot be read at all; the text is one line for the user."""


class NoFrameError(ValueError):
    """A line that cannot be read, and why, in words for the user."""


class Logged(NamedTuple):
    """A frame of a log; ``time_ns`` is None where the log has no times."""

    time_ns: int | None
    channel: str
    frame: Frame


def logged(time_ns: int | None, channel: str, frame: Frame) -> Logged:
    """Return a frame that a bus can carry, at a time that a clock can show; ValueError."""
    can_id, data, flags = frame
    if not 0 <= can_id < 1 << (29 if flags & (EXTENDED | ERROR) else 11):
        raise NoFrameError(f"an identifier of {can_id:#x}")
    if len(data) > (64 if flags & FD else 8):
        raise NoFrameError(f"{len(data)} bytes")
    if abs(time_ns or 0) >= TIME_NS_LIMIT:
        raise NoFrameError("a time that no clock shows")
    return Logged(time_ns, channel, frame)
