"""[limits]: bounds on angle and rate that every command passes before it is sent, under any law.

    lo = max(−steer_rad_max, last − step_rad_max)
    hi = min(+steer_rad_max, last + step_rad_max)      step_rad_max = rate limit · period

A command that is not finite (NaN, ±∞) is never sent: the last one is kept, and the node counts the
failure and falls back to HOLDING. The step functions are plain arithmetic on floats.
"""

import math
from typing import Annotated, NamedTuple

from pydantic import Field

from ...dbc.messages import SteeringCommand
from ...dbc.messages import limits as signal_limits
from ...runtime.node import NS_PER_S
from ...runtime.settings import Settings


class LimitSettings(Settings):
    """Limits on every command, under any law.

    ``steer_rad_max``         to either side, within the range of the command's signal [rad]
    ``steer_rate_rad_s_max``  [rad/s]
    """

    steer_rad_max: Annotated[
        float, Field(gt=0.0, le=signal_limits(SteeringCommand)["steer_rad"].maximum)
    ] = 0.6
    steer_rate_rad_s_max: Annotated[float, Field(gt=0.0, le=1000.0)] = 2.0


class SteerLimits(NamedTuple):
    """Bounds of one command: to either side, and from one command to the next [rad]."""

    steer_rad_max: float
    step_rad_max: float


def steer_limits_of(table: LimitSettings, period_ns: int) -> SteerLimits:
    """Return the bounds of one command."""
    step_rad_max = table.steer_rate_rad_s_max * period_ns / NS_PER_S
    return SteerLimits(table.steer_rad_max, step_rad_max)


def limit_step(p: SteerLimits, last_steer_rad: float, wanted_steer_rad: float) -> float:
    """Return the command nearest to the wanted one that both limits allow [rad].

    ``last_steer_rad`` is what this function returned one period ago (0 before the first command),
    so it is within the angle limit itself.
    """
    if not math.isfinite(wanted_steer_rad):
        return last_steer_rad
    steer_rad_max, step_rad_max = p.steer_rad_max, p.step_rad_max
    low_rad, high_rad = last_steer_rad - step_rad_max, last_steer_rad + step_rad_max
    if low_rad < -steer_rad_max:
        low_rad = -steer_rad_max
    if high_rad > steer_rad_max:
        high_rad = steer_rad_max
    if wanted_steer_rad < low_rad:
        return low_rad
    return high_rad if wanted_steer_rad > high_rad else wanted_steer_rad


def limit_name(p: SteerLimits, steer_rad: float) -> str:
    """Return which limit decided about a command that is not the wanted one."""
    return "angle" if abs(steer_rad) >= p.steer_rad_max else "rate"
