"""The quantities in each of our messages, and how they are read from it."""

from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import Any

from ..messages import (
    LateralError,
    Message,
    Mode,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
)
from .settings import Quantity

_ENGAGED = (Mode.ACTIVE, Mode.HOLDING)
_APPLYING = (
    SteeringStatusCode.APPLYING,
    SteeringStatusCode.LIMITED,
    SteeringStatusCode.LIMITED_BY_SAFETY,
    SteeringStatusCode.DRIVER_STEERS,
)
Values = Mapping[Quantity, float]


def _fields(*names: Quantity) -> dict[Quantity, Callable[[Any], float]]:
    return {name: attrgetter(name) for name in names}


SAID_BY: Mapping[type[Message], Mapping[Quantity, Callable[[Any], float]]] = {
    SteeringCommand: {
        **_fields(Quantity.STEER),
        Quantity.ENGAGED: lambda command: float(command.mode in _ENGAGED),
    },
    LateralError: _fields(Quantity.LATERAL_ERROR, Quantity.HEADING_ERROR),
    SteeringStatus: {
        **_fields(Quantity.WHEEL_ANGLE),
        Quantity.APPLYING: lambda status: float(status.status in _APPLYING),
    },
    VehicleState: _fields(Quantity.SPEED, Quantity.YAW_RATE, Quantity.PREVIEW_CURVATURE),
}
"""The quantities of each message, and how they are read from it."""
COMMANDS = frozenset(SAID_BY[SteeringCommand])
"""What the controller sends; the plant sends the others."""


def values_of(message: Message) -> Values:
    """Return what a message of ours says, by quantity."""
    return {name: read(message) for name, read in SAID_BY.get(type(message), {}).items()}
