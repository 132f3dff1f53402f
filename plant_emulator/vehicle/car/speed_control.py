"""Speed control: the profile of the wanted speed, and the acceleration that follows it.

    a = a_w + k (v_w − u)       within the limits of drive and brakes, changing by the jerk at most

    v_w, a_w   wanted speed and its rate      u   speed      k   gain [1/s]

Between the points of a profile over time the speed changes linearly, over arc length with a
constant acceleration. Behind the last point it stays.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import inf, sqrt
from typing import NamedTuple

HOLD_M_S2 = 1.0
"""Of the brakes of a car that is to stand; chosen."""


class SpeedLeg(NamedTuple):
    """A leg of the profile.

    ``end``          where the next one begins: time [s], or arc length [m] of the CG
    ``start``        of this one
    ``speed_m_s``    at its start
    ``rate``         dv/dt [m/s²], or d(v²)/ds [m/s²]
    """

    end: float
    start: float
    speed_m_s: float
    rate: float


class SpeedParams(NamedTuple):
    """A profile, and the limits of the control."""

    legs: Sequence[SpeedLeg]
    over_arc_length: bool
    gain_1_s: float
    drive_m_s2_max: float
    brake_m_s2_max: float
    jerk_m_s3_max: float


def speed_legs(points: Sequence[tuple[float, float]], *, over_arc_length: bool) -> list[SpeedLeg]:
    """Return the legs of a profile of (time or arc length, speed); the first point is at 0."""
    power = 2 if over_arc_length else 1
    legs = []
    for (at, speed_m_s), (end, after_m_s) in pairwise(points):
        rate = (after_m_s**power - speed_m_s**power) / (end - at)
        legs.append(SpeedLeg(end, at, speed_m_s, rate))
    at, speed_m_s = points[-1]
    return [*legs, SpeedLeg(inf, at, speed_m_s, 0.0)]


def wanted_speed(p: SpeedParams, leg: int, at: float) -> tuple[int, float, float]:
    """Return the leg, the wanted speed [m/s] and its rate [m/s²] at a time or arc length."""
    while at >= p.legs[leg].end:
        leg += 1
    here = p.legs[leg]
    start, speed_m_s, rate = here.start, here.speed_m_s, here.rate
    if not p.over_arc_length:
        return leg, speed_m_s + rate * (at - start), rate
    square = speed_m_s * speed_m_s + rate * (at - start)
    return leg, sqrt(square) if square > 0.0 else 0.0, 0.5 * rate


def demand_step(
    p: SpeedParams,
    demand_m_s2: float,
    wanted_m_s: float,
    rate_m_s2: float,
    speed_m_s: float,
    h_s: float,
) -> float:
    """Return the acceleration that drive and brakes are asked for after ``h_s``."""
    wanted_m_s2 = rate_m_s2 + p.gain_1_s * (wanted_m_s - speed_m_s)
    if wanted_m_s == 0.0 and rate_m_s2 <= 0.0:
        wanted_m_s2 = min(wanted_m_s2, -HOLD_M_S2)
    wanted_m_s2 = min(max(wanted_m_s2, -p.brake_m_s2_max), p.drive_m_s2_max)
    step_m_s2 = p.jerk_m_s3_max * h_s
    return min(max(wanted_m_s2, demand_m_s2 - step_m_s2), demand_m_s2 + step_m_s2)
