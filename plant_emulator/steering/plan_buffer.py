"""Plan buffer: plays the newest STEERING_PLAN by the plant's own clock, its samples.

A plan says which angle is to act at which sample, by the E2E counter of that sample. At every
sample the buffer returns the value for now:

    u[k] = u_i + (u_{i+1} - u_i) · part        i, part = quotient, rest of (k - first) / spacing

Only the first of these values counts as a command that has arrived; ``hold_and_fallback`` decides
for how long the later ones move the wheel. A plan that has run out gives no value. A single command
ends a plan.
"""

import math
from collections.abc import Sequence

from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import STEER_FIELDS, SteeringCommand, SteeringPlan, steers_of

PLAN_VALUES = len(STEER_FIELDS)


def has_run_out(age: int, spacing: int) -> bool:
    """Whether a plan has no value for a sample ``age`` samples after its first."""
    return age > (PLAN_VALUES - 1) * spacing


def planned_rad(age: int, spacing: int, steers_rad: Sequence[float]) -> float:
    """Return the angle of a plan ``age`` samples after its first, before it has run out [rad]."""
    index, rest = age // spacing, age % spacing
    if rest == 0:
        return steers_rad[index]
    before_rad = steers_rad[index]
    return before_rad + (steers_rad[index + 1] - before_rad) * (rest / spacing)


class PlanBuffer:
    """Holds the newest plan to play in ``plan``; None without one. A single command ends it."""

    def __init__(self) -> None:
        self.plan: SteeringPlan | None = None
        self._latency_s = math.nan
        self._is_new = False

    def on_plan(self, arrived: SteeringPlan, latency_s: float) -> None:
        """Keep a plan in place of the one before."""
        self.plan, self._latency_s, self._is_new = arrived, latency_s, True

    def play(self, sample: int) -> tuple[SteeringCommand, float, bool] | None:
        """Return the command for a sample, by its E2E counter.

        With it come the latency of the plan [s], and whether it is the first command of the plan.
        None if there is no command.
        """
        plan, is_new = self.plan, self._is_new
        if plan is None:
            return None
        self._is_new = False
        age = (sample - plan.first_sample) % COUNTERS
        if has_run_out(age, plan.spacing):
            self.plan = None
            return None
        steer_rad = planned_rad(age, plan.spacing, steers_of(plan))
        command = SteeringCommand(
            steer_rad=steer_rad, command_counter=plan.plan_number, mode=plan.mode
        )
        return command, self._latency_s, is_new
