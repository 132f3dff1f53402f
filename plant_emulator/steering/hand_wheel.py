"""Hand wheel: who steers, the law or the driver, and which angle the driver asks for.

The controller decides (HAND_WHEEL_FEEDBACK). Until it has, and once it has been silent for
SILENCE_NS, the driver steers. Both messages come through the latency of commands, and the angle
acts through the same guard as a command.
"""

from typing import NamedTuple

from pydantic import Field

from ...dbc.messages import SteeredBy
from ...runtime.settings import Settings

_LAW = int(SteeredBy.LAW)
SILENCE_NS = 500_000_000
"""Chosen; the hand wheel waits as long."""


class HandWheelSettings(Settings):
    """`[hand_wheel]`: a hand wheel on the bus may steer."""

    steering_ratio: float = Field(16.0, ge=1.0, le=40.0)
    """Angle of the hand wheel over that of the road wheels, until HAND_WHEEL_FEEDBACK says it."""


class Heard(NamedTuple):
    """Until when the law steers [ns], by what the controller said last, and the steering ratio."""

    law_until_ns: int
    ratio: float


def heard_step(x: Heard, steered_by: int, ratio: float, now_ns: int) -> Heard:
    """Process who steers, and the ratio, of a HAND_WHEEL_FEEDBACK."""
    law_until_ns = now_ns + SILENCE_NS if steered_by == _LAW else 0
    return Heard(law_until_ns, ratio if ratio >= 1.0 else x.ratio)


def driver_steers(x: Heard, now_ns: int) -> bool:
    """Whether HAND_WHEEL_STATE sets the target of the wheels, and no command."""
    return now_ns >= x.law_until_ns
