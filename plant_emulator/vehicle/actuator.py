"""Steering actuator: a position servo with play, angle limit, rate limit and first-order lag.

    target = command, clipped to ± angle limit
    goal   = the point nearest to δ in [target − dead band, target + dead band]
    δ'     = (goal − δ)/lag, clipped to ± rate limit

    δ   wheel_rad   angle of the front wheel [rad]

Not in the paper, whose steering is ideal; so is the actuator with the default parameters: the wheel
is the command, bit for bit. A command is held until the next, so the wheel moves in closed form: it
ramps at the rate limit while the goal is further than rate · lag away, then settles exponentially
(without lag it stops on the goal). Only the end of the ramp is an event, at a whole nanosecond.
"""

import math
from enum import IntEnum
from typing import NamedTuple

from ...runtime.node import NEVER_NS, NS_PER_S


class ActuatorParams(NamedTuple):
    """An actuator; the defaults make it transparent."""

    lag_s: float = 0.0
    angle_limit_rad: float = math.inf
    rate_limit_rad_s: float = math.inf
    dead_band_rad: float = 0.0


class WheelPhase(IntEnum):
    """How the wheel moves until the segment ends."""

    HELD = 0
    RAMPING = 1
    SETTLING = 2


_HELD, _RAMPING, _SETTLING = WheelPhase


WheelSegment = tuple[float, float, WheelPhase, float, bool, int]
"""Motion of the wheel from its start until its end.

    wheel_rad         δ at the start
    wheel_rate_rad_s  δ' at the start; constant while RAMPING, decaying with the lag while SETTLING
    phase             of its motion
    goal_rad          where it moves to
    clipped           whether the command lies beyond the angle limit
    end_ns            when `end_ramp` is due; NEVER_NS if only a command ends the segment

A plain tuple like the other states of the motion, which is made and unpacked at every event.
"""


def at_rest(wheel_rad: float) -> WheelSegment:
    """Return the segment of a wheel at rest."""
    return wheel_rad, 0.0, _HELD, wheel_rad, False, NEVER_NS


def command_wheel(
    p: ActuatorParams, wheel_rad: float, steer_rad: float, now_ns: int
) -> WheelSegment:
    """Return the segment that a command (finite) starts with the wheel at ``wheel_rad``."""
    lag_s, angle_limit_rad, rate_limit_rad_s, dead_band_rad = p
    clipped = not -angle_limit_rad <= steer_rad <= angle_limit_rad
    target = math.copysign(angle_limit_rad, steer_rad) if clipped else steer_rad
    if wheel_rad < target - dead_band_rad:
        goal = target - dead_band_rad
    elif wheel_rad > target + dead_band_rad:
        goal = target + dead_band_rad
    else:
        goal = wheel_rad
    distance_rad = abs(goal - wheel_rad)
    if rate_limit_rad_s == math.inf or distance_rad <= rate_limit_rad_s * lag_s:
        return end_ramp(p, wheel_rad, goal, clipped)
    ramp_s = distance_rad / rate_limit_rad_s - lag_s
    rate = math.copysign(rate_limit_rad_s, goal - wheel_rad)
    end_ns = now_ns + math.ceil(ramp_s * NS_PER_S)
    return wheel_rad, rate, _RAMPING, goal, clipped, end_ns


def end_ramp(p: ActuatorParams, wheel_rad: float, goal_rad: float, clipped: bool) -> WheelSegment:
    """Return the segment that follows a ramp which has reached ``wheel_rad``."""
    if p.lag_s > 0.0:
        rate = (goal_rad - wheel_rad) / p.lag_s
        return wheel_rad, rate, _SETTLING, goal_rad, clipped, NEVER_NS
    return goal_rad, 0.0, _HELD, goal_rad, clipped, NEVER_NS


def is_limited(segment: WheelSegment) -> bool:
    """Return whether the angle limit or the rate limit shapes the wheel's motion now."""
    _, _, phase, _, clipped, _ = segment
    return clipped or phase == _RAMPING
