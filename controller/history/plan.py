"""A plan: the commands of a law for the coming time, as one row of numbers.

    row = (first, spacing, u_0, ..., u_17)

u_i is to act at the plant's sample first + i · spacing; in between the plant draws straight lines,
and after the last value it holds that. A spacing of 0 is a single command u_0, for all samples.
The plant plays a plan from sample to sample, so a law that plans knows what acts at each.
"""

from collections.abc import MutableSequence, Sequence

from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import STEER_FIELDS, Mode, SteeringPlan
from ..limits.steer_limits import SteerLimits, limit_step

VALUES = len(STEER_FIELDS)
SPACING_MAX = 15
"""17 of these are as many samples as the wire distinguishes."""
ROW_LENGTH = 2 + VALUES


def value_at(row: Sequence[float], sample: float) -> float:
    """Return the angle that a plan or a single command sets at a sample [rad]."""
    spacing = row[1]
    age = sample - row[0]
    if spacing == 0.0 or age <= 0.0:
        return row[2]
    if age >= (VALUES - 1) * spacing:
        return row[ROW_LENGTH - 1]
    index = int(age // spacing)
    before_rad = row[2 + index]
    return before_rad + (row[3 + index] - before_rad) * (age / spacing - index)


def limit_plan(
    p: SteerLimits,
    periods_per_sample: float,
    acting: int,
    before: Sequence[float],
    row: MutableSequence[float],
) -> None:
    """Limit angle and rate of a plan, in place.

    ``acting``  index of the value for the time at which the present one acts. The others are
                limited from there on, in both directions
    ``before``  the row of the period before, from which each value is a step at most: the wheel
                must not jump from one plan to the next, whenever that comes
    """
    steer_rad_max, step_rad_max = p
    spacing, first = row[1], 2 + acting
    earlier = row[0] - 1.0 / periods_per_sample
    row[first] = limit_step(p, value_at(before, earlier + acting * spacing), row[first])
    apart_rad = step_rad_max * spacing * periods_per_sample
    apart = SteerLimits(steer_rad_max, apart_rad)
    # The calls take long, and few values need them.
    for step, end in ((1, ROW_LENGTH), (-1, 1)):
        for index in range(first + step, end, step):
            wanted_rad, beside_rad = row[index], row[index - step]
            if not (abs(wanted_rad - beside_rad) <= apart_rad and abs(wanted_rad) <= steer_rad_max):
                row[index] = limit_step(apart, beside_rad, wanted_rad)
    for index in range(2, ROW_LENGTH):
        before_rad = value_at(before, earlier + (index - 2) * spacing)
        if abs(row[index] - before_rad) > step_rad_max:
            row[index] = limit_step(p, before_rad, row[index])


def hold(row: MutableSequence[float], steer_rad: float) -> None:
    """Turn a row into a single command."""
    row[1] = 0.0
    row[2] = steer_rad


def copy_row(row: Sequence[float], to: MutableSequence[float]) -> None:
    """Copy a row into another one."""
    for index in range(ROW_LENGTH):
        to[index] = row[index]


def plan_message(row: Sequence[float], number: int, mode: Mode) -> SteeringPlan:
    """Return a plan as sent; ``number`` is the counter of its command."""
    return SteeringPlan(
        plan_number=number,
        mode=mode,
        first_sample=int(row[0]) % COUNTERS,
        spacing=int(row[1]),
        **dict(zip(STEER_FIELDS, row[2:], strict=True)),
    )
