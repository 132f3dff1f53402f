"""No command leaves that is not finite, beyond the angle limit or faster than the rate limit."""

import math

from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.controller.limits.fades_and_ramps import ramp_step
from steer_by_wire.controller.limits.steer_limits import SteerLimits, limit_step

LIMITS = st.builds(SteerLimits, st.floats(0.01, 1.3), st.floats(1e-4, 10.0))
ANYTHING = st.floats(allow_nan=True, allow_infinity=True)
ROUNDING_RAD = 1e-15


@given(LIMITS, st.lists(ANYTHING, max_size=30))
def test_commands_stay_finite_and_within_both_limits(p: SteerLimits, wanted: list[float]) -> None:
    last_rad = 0.0
    for wanted_rad in wanted:
        sent_rad = limit_step(p, last_rad, wanted_rad)
        assert math.isfinite(sent_rad)
        assert abs(sent_rad) <= p.steer_rad_max
        assert abs(sent_rad - last_rad) <= p.step_rad_max + ROUNDING_RAD
        last_rad = sent_rad


@given(LIMITS, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_a_command_within_the_limits_is_not_touched(
    p: SteerLimits, last_rad: float, wanted_rad: float
) -> None:
    low_rad = max(-p.steer_rad_max, last_rad - p.step_rad_max)
    high_rad = min(p.steer_rad_max, last_rad + p.step_rad_max)
    if low_rad <= wanted_rad <= high_rad:
        assert limit_step(p, last_rad, wanted_rad) == wanted_rad


def test_a_command_beyond_a_limit_is_moved_to_it() -> None:
    p = SteerLimits(steer_rad_max=0.5, step_rad_max=0.1)
    assert limit_step(p, 0.0, 1.0) == 0.1
    assert limit_step(p, 0.0, -1.0) == -0.1
    assert limit_step(p, 0.45, 1.0) == 0.5
    assert limit_step(p, -0.45, -1.0) == -0.5


def test_a_command_that_is_no_number_repeats_the_last_one() -> None:
    p = SteerLimits(steer_rad_max=0.5, step_rad_max=0.1)
    for wanted_rad in (math.nan, math.inf, -math.inf):
        assert limit_step(p, 0.3, wanted_rad) == 0.3


@given(st.floats(1e-3, 1.0), st.floats(-1.5, 1.5))
def test_a_ramp_reaches_zero_without_crossing_it(step_rad: float, start_rad: float) -> None:
    value_rad = start_rad
    for _ in range(math.ceil(abs(start_rad) / step_rad) + 1):
        following_rad = ramp_step(step_rad, value_rad)
        assert abs(following_rad - value_rad) <= step_rad + ROUNDING_RAD
        assert following_rad * start_rad >= 0.0
        value_rad = following_rad
    assert value_rad == 0.0
