"""How a passive listener decodes a bus; here one with our own messages.

``dialect.overheard`` decodes the bus of a car. Programs that show a bus take either, and name the
messages as ``listed`` does.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple, Protocol

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


class CarSignals(Protocol):
    """The signals of a car's message, read from the data of an accepted frame."""

    @property
    def signals(self) -> Sequence[str]:
        """Their names."""
        ...

    def values(self, data: bytes) -> Mapping[str, float]:
        """Return them in the database's units."""
        ...

    def text(self, data: bytes) -> str:
        """Return them in words."""
        ...


class Listening(Protocol):
    """How a bus is decoded.

    ``listed``        the messages on it, by their names there
    ``from_plant``    identifiers of the plant's frames
    ``kept_ids``      identifiers of our own messages that are on it
    ``signals``       of a car, ``MESSAGE.SIGNAL``, by the quantity that it carries
    ``names``         of a car's messages, by the name of ours that they stand for
    ``car_messages``  of a car, by name
    """

    listed: Mapping[str, Listed]
    from_plant: frozenset[int]
    kept_ids: frozenset[int]
    signals: Mapping[str, str]
    names: Mapping[str, str]
    car_messages: Mapping[str, CarSignals]

    def hear(self, frame: Frame, now_ns: int) -> Heard:
        """Take a frame."""
        ...

    def counts(self, name: str) -> MessageCounts | None:
        """Return the counts of a message of the car; None for one of ours."""
        ...


class OurMessages:
    """A bus that speaks our own messages: every frame says what it is."""

    listed: Mapping[str, Listed] = MappingProxyType(
        {name: Listed(CAN_IDS[it], CYCLE_TIMES_MS[it]) for name, it in MESSAGE_TYPES.items()}
    )
    from_plant = frozenset(CAN_IDS[kind] for kind in sent_by("PLANT"))
    kept_ids = frozenset(CAN_IDS.values())
    signals: Mapping[str, str] = MappingProxyType({})
    names: Mapping[str, str] = MappingProxyType({})
    car_messages: Mapping[str, CarSignals] = MappingProxyType({})

    def hear(self, frame: Frame, now_ns: int) -> Heard:  # noqa: ARG002 as a car's bus
        """Take a frame."""
        return Heard((frame,))

    def counts(self, name: str) -> None:
        """Return None: nothing here is of a car."""


OUR_MESSAGES: Listening = OurMessages()
"""The one such bus: it counts nothing, so that all who listen may share it."""
