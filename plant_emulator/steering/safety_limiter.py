"""Limits of a steering command; and whether the wheel follows its target.

    a_y = g δ     in a steady turn (``vehicle.steady_turn``)

    cause                 |δ| at most      change of δ within half a second at most
    ANGLE                 δ_max
    ANGLE_RATE                             δ'_max · 0.5 s
    LATERAL_ACCELERATION  a_max/g
    LATERAL_JERK                           j_max · 0.5 s/g

    δ   steer_rad   [rad]

ISO 11270:2014, 5.4, limits the lateral acceleration to 3 m/s² and the moving average over half a
second of the lateral jerk to 5 m/s³. A command is a step with infinite jerk, so only such an
average is meaningful. It needs no memory of all commands: the smallest and the largest output of
the present quarter of a second and of the two before it are those of the last 0.5 to 0.75 s, and an
output stays within ``sweep`` of both. So no two outputs within 0.5 s differ by more than the limit,
and commands that keep the limit within 0.75 s pass unchanged, bit for bit.

If the wheel differs from its target by more than a tolerance for too long, it does not follow, and
the steering is no longer reliable.
"""

import math
from enum import IntEnum
from typing import NamedTuple

from ...runtime.fast_named_tuple import new_record

AVERAGING_S = 0.5
"""Averaging time of the two rate limits; for the jerk that of ISO 11270."""
SLOT_NS = 250_000_000
"""Half of it: the time over which extremes of the output are stored."""


class Cause(IntEnum):
    """The limit that determined an output."""

    NONE = 0
    ANGLE = 1
    ANGLE_RATE = 2
    LATERAL_ACCELERATION = 3
    LATERAL_JERK = 4
    NOT_FINITE = 5
    """The command was NaN: the output stays."""


_NONE, _NOT_FINITE = int(Cause.NONE), int(Cause.NOT_FINITE)


class LimitRow(NamedTuple):
    """One row of the table; infinite if there is no limit."""

    cause: int
    reach_rad: float
    sweep_rad: float


class LimitTable(NamedTuple):
    """The rows of the table; what is within the least reach and sweep is within all of them."""

    rows: tuple[LimitRow, ...]
    least_reach_rad: float
    least_sweep_rad: float


class LimiterParams(NamedTuple):
    """The table, and the check of the wheel.

    ``tolerance_rad``  largest difference between the wheel and its target
    ``follow_ns``      how long the difference may be larger [ns]
    ``stop_rad``       the actuator's stop, which replaces targets beyond
    """

    table: LimitTable
    tolerance_rad: float
    follow_ns: int
    stop_rad: float


class LimiterState(NamedTuple):
    """State of the limiter.

    ``steer_rad``     the output, held until the next
    ``cause``         of its last change, NONE if the command passed as it was
    ``slot``          quarter of a second that the time is in
    ``low_rad``, ...  extremes of the output in that slot, and in the two before it
    """

    steer_rad: float
    cause: int
    slot: int
    low_rad: float
    high_rad: float
    low_1_rad: float
    high_1_rad: float
    low_2_rad: float
    high_2_rad: float


def start_limiter() -> LimiterState:
    """Return the state at time 0, wheel straight."""
    return LimiterState(0.0, _NONE, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def limit_table(
    gain_m_s2: float, angle: float, angle_rate: float, acceleration: float, jerk: float
) -> LimitTable:
    """Return the table of four limits [rad, rad/s, m/s², m/s³]; infinite: off."""
    rows = (
        LimitRow(int(Cause.ANGLE), angle, math.inf),
        LimitRow(int(Cause.ANGLE_RATE), math.inf, angle_rate * AVERAGING_S),
        LimitRow(int(Cause.LATERAL_ACCELERATION), acceleration / gain_m_s2, math.inf),
        LimitRow(int(Cause.LATERAL_JERK), math.inf, jerk * AVERAGING_S / gain_m_s2),
    )
    reaches_rad, sweeps_rad = [row.reach_rad for row in rows], [row.sweep_rad for row in rows]
    return LimitTable(rows, min(reaches_rad), min(sweeps_rad))


def limit_steer(
    p: LimiterParams, x: LimiterState, steer_rad: float, time_ns: int
) -> tuple[LimiterState, float]:
    """Return the state from ``time_ns`` (no earlier than any before) on, and its output [rad]."""
    steer_before, _, slot_before, low, high, low_1, high_1, low_2, high_2 = x
    slot = time_ns // SLOT_NS
    if slot > slot_before:
        for _ in range(min(slot - slot_before, 3)):  # nothing older than three slots counts
            low_2, high_2, low_1, high_1 = low_1, high_1, low, high
            low = high = steer_before
    # These comparisons and the record without its constructor save 5 % of a tick.
    lowest = low if low < low_1 else low_1
    lowest = lowest if lowest < low_2 else low_2
    highest = high if high > high_1 else high_1
    highest = highest if highest > high_2 else high_2
    steer, cause = steer_rad, _NONE
    if not math.isfinite(steer_rad):
        steer, cause = steer_before, _NOT_FINITE
    rows, least_reach, least_sweep = p.table
    is_within = -least_reach <= steer <= least_reach
    if not (is_within and highest - least_sweep <= steer <= lowest + least_sweep):
        for cause_of_row, reach_rad, sweep_rad in rows:
            if steer < -reach_rad or steer < highest - sweep_rad:
                steer, cause = max(-reach_rad, highest - sweep_rad), cause_of_row
            elif steer > reach_rad or steer > lowest + sweep_rad:
                steer, cause = min(reach_rad, lowest + sweep_rad), cause_of_row
    low = low if low < steer else steer
    high = high if high > steer else steer
    state = (steer, cause, slot, low, high, low_1, high_1, low_2, high_2)
    return new_record(LimiterState, state), steer


def is_at_target(p: LimiterParams, steer_rad: float, wheel_rad: float) -> bool:
    """Whether a measured wheel angle is within the tolerance of the output ``steer_rad``."""
    _, tolerance_rad, _, stop_rad = p
    if not -stop_rad <= steer_rad <= stop_rad:
        steer_rad = math.copysign(stop_rad, steer_rad)
    return abs(wheel_rad - steer_rad) <= tolerance_rad
