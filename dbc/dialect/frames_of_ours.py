"""What one who only listens takes of a bus: our own frames as they are, a car's as ours."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...runtime.frame import Frame

if TYPE_CHECKING:
    from .overheard import Overheard


def frames_of_ours(overheard: "Overheard | None", frame: Frame, now_ns: int) -> Sequence[Frame]:
    """Return what a frame that came at ``now_ns`` says as frames of ours.

    ``overheard``  understands the bus of a car; None for our own messages
    """
    return (frame,) if overheard is None else overheard.frames(frame, now_ns)
