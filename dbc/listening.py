"""A passive listener on a bus with our own messages; ``dialect.reader`` has a car's.

Programs that show a bus take either, and name the messages as ``listed`` does.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from ..runtime.frame import Frame
from .messages import CAN_IDS, CYCLE_TIMES_MS, MESSAGE_TYPES, sent_by


class Listed(NamedTuple):
    """A message on the bus, and its cycle; 0 for one that is sent when needed."""

    can_id: int
    cycle_ms: float


class MessageCounts(NamedTuple):
    """Frames under the identifier of one message.

    ``accepted``  intact, within range, newer than all before
    ``missing``   counters that the accepted frames skip; a late frame was skipped before it came,
                  so it is counted here too
    ``late``      older than the newest
    ``refused``   all others, by cause
    """

    accepted: int
    missing: int
    late: int
    refused: Mapping[str, int]


class Heard(NamedTuple):
    """What a frame says.

    ``ours``        as frames of ours
    ``name``        of the car's message; empty for a frame of ours, or one that is refused
    ``is_foreign``  it is no message of the bus
    """

    ours: Sequence[Frame]
    name: str = ""
    is_foreign: bool = False


class Listening(NamedTuple):
    """How a bus is decoded.

    ``listed``        the messages on it, by their names there
    ``from_plant``    identifiers of the plant's frames
    ``signals``       of a car, ``MESSAGE.SIGNAL``, by the quantity that it carries
    ``names``         of a car's messages, by the name of ours that they stand for
    ``car_messages``  of a car, by name: its ``CarMessage``
    ``hear``          takes a frame, and the time at which it came [ns]
    ``counts``        of a message of the car, by name; None for one of ours
    """

    listed: Mapping[str, Listed]
    from_plant: frozenset[int]
    signals: Mapping[str, str] = MappingProxyType({})
    names: Mapping[str, str] = MappingProxyType({})
    car_messages: Mapping[str, Any] = MappingProxyType({})
    hear: Callable[[Frame, int], Heard] = lambda frame, _now_ns: Heard((frame,))
    counts: Callable[[str], MessageCounts | None] = lambda _name: None


OUR_MESSAGES = Listening(
    {name: Listed(CAN_IDS[it], CYCLE_TIMES_MS[it]) for name, it in MESSAGE_TYPES.items()},
    frozenset(CAN_IDS[kind] for kind in sent_by("PLANT")),
)
"""A bus with our own messages: every frame says what it is. It counts nothing, so all share it."""
