"""The messages in what was sent."""

from collections.abc import Iterable
from typing import TypeVar

from steer_by_wire.dbc.messages import Decoded, decode
from steer_by_wire.runtime.frame import Frame

M = TypeVar("M")


def decoded(frame: Frame) -> Decoded:
    """Decode a frame that must be right."""
    found = decode(frame)
    assert isinstance(found, Decoded), (frame, found)
    return found


def messages_in(frames: Iterable[Frame], kind: type[M]) -> list[M]:
    """Return the messages of one kind; what does not decode is somebody else's."""
    found = [one.message for one in map(decode, frames) if isinstance(one, Decoded)]
    return [message for message in found if isinstance(message, kind)]
