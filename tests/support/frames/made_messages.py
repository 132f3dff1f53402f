"""Messages with the fields that a test is about; the others are 0, or the nearest that is allowed.

So a signal that is added to a message breaks no test.
"""

from collections.abc import Iterable
from enum import IntEnum
from functools import cache
from typing import Any, TypeVar, get_type_hints

from steer_by_wire.dbc.contract.message_records import CURVATURE_FIELDS, STEER_FIELDS
from steer_by_wire.dbc.messages import (
    Direction,
    LatencyConfig,
    LatencyModel,
    LateralError,
    Mode,
    PathAhead,
    SteeringCommand,
    SteeringPlan,
    VehicleState,
    limits,
)

M = TypeVar("M", bound=tuple[Any, ...])


@cache
def _zeros(kind: type[M]) -> dict[str, Any]:
    allowed = limits(kind)  # type: ignore[arg-type]
    values = {name: min(max(0, allowed[name].minimum), allowed[name].maximum) for name in allowed}
    return {
        name: hint(int(values[name]) if issubclass(hint, (int, IntEnum)) else values[name])
        for name, hint in get_type_hints(kind).items()
    }


def message_with(kind: type[M], **fields: Any) -> M:
    """Return a message with these fields."""
    return kind(**{**_zeros(kind), **fields})


def command_of(
    steer_rad: float = 0.0, command_counter: int = 0, mode: Mode = Mode.ACTIVE
) -> SteeringCommand:
    """Return a command of an active controller."""
    return message_with(
        SteeringCommand, steer_rad=steer_rad, command_counter=command_counter, mode=mode
    )


def error_of(lateral_error_m: float = 0.0) -> LateralError:
    """Return a lateral error of a vehicle that heads along its path."""
    return message_with(LateralError, lateral_error_m=lateral_error_m)


def motion_of(
    speed_m_s: float, yaw_rate_rad_s: float = 0.0, preview_curvature_1_m: float = 0.0
) -> VehicleState:
    """Return the motion of a vehicle, straight ahead if nothing else is said."""
    return message_with(
        VehicleState,
        speed_m_s=speed_m_s,
        yaw_rate_rad_s=yaw_rate_rad_s,
        preview_curvature_1_m=preview_curvature_1_m,
    )


def latency_of(
    direction: Direction,
    mean_s: float = 0.0,
    spread_s: float = 0.0,
    loss: float = 0.0,
    model: LatencyModel = LatencyModel.CONSTANT,
) -> LatencyConfig:
    """Return a latency, constant if nothing else is said."""
    return message_with(
        LatencyConfig, direction=direction, model=model, mean_s=mean_s, spread_s=spread_s, loss=loss
    )


def plan_of(steers_rad: Iterable[float], **fields: Any) -> SteeringPlan:
    """Return a plan of these 18 angles by an active controller."""
    steers = dict(zip(STEER_FIELDS, steers_rad, strict=True))
    return message_with(SteeringPlan, mode=Mode.ACTIVE, **steers, **fields)


def path_ahead_of(curvatures_1_m: Iterable[float], **fields: Any) -> PathAhead:
    """Return these 26 curvatures of the path ahead."""
    values = dict(zip(CURVATURE_FIELDS, curvatures_1_m, strict=True))
    return message_with(PathAhead, **values, **fields)
