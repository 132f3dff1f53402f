"""The limits, ramps and fades of the controller against rules written apart."""

import math
from collections.abc import Callable
from random import Random
from types import ModuleType

import pytest

from steer_by_wire.controller.limits import fades_and_ramps, steer_limits
from tests.support.suite.mutation import assert_noticed

EQUIVALENT = {
    # At a tie both sides are the same number.
    "steer_limits": {
        "low_rad < -steer_rad_max  ->  low_rad <= -steer_rad_max",
        "high_rad > steer_rad_max  ->  high_rad >= steer_rad_max",
        "wanted_steer_rad < low_rad  ->  wanted_steer_rad <= low_rad",
        "wanted_steer_rad > high_rad  ->  wanted_steer_rad >= high_rad",
        # No command is beyond it.
        "abs(steer_rad) >= p.steer_rad_max  ->  abs(steer_rad) == p.steer_rad_max",
    },
    "fades_and_ramps": {"value > step  ->  value >= step", "value < -step  ->  value <= -step"},
}
"""What behaves as the original for all numbers."""
SHARES = (0.0, 1e-9, 0.5, 1.0, 1.0 + 1e-9, 2.0, 10.0)


def about(random: Random, scale: float) -> float:
    """Return a number at, beside or far from a bound."""
    return random.choice((-1.0, 1.0)) * random.choice(SHARES) * scale


def check_limits(tested: ModuleType) -> None:
    """Check that a limited command is the nearest of those that are allowed."""
    table = tested.LimitSettings()
    assert tested.steer_limits_of(table, 10_000_000) == (0.6, 0.02)
    assert (table.steer_rad_max, table.steer_rate_rad_s_max) == (0.6, 2.0)
    check_ranges(tested)
    random = Random(1)
    for _ in range(2000):
        p = tested.SteerLimits(random.choice((0.5, 0.6)), random.choice((0.1, 0.5, 2.0)))
        last_rad = max(-p.steer_rad_max, min(about(random, p.steer_rad_max), p.steer_rad_max))
        wanted_rad = last_rad + about(random, p.step_rad_max)
        wanted_rad = random.choice((wanted_rad, about(random, p.steer_rad_max)))
        low_rad, high_rad = last_rad - p.step_rad_max, last_rad + p.step_rad_max
        by_hand = sorted((low_rad, wanted_rad, high_rad))[1]
        by_hand = sorted((-p.steer_rad_max, by_hand, p.steer_rad_max))[1]
        assert tested.limit_step(p, last_rad, wanted_rad) == by_hand
        is_at_angle = by_hand in (p.steer_rad_max, -p.steer_rad_max)
        assert (tested.limit_name(p, by_hand) == "angle") == is_at_angle
        for bad in (math.nan, math.inf, -math.inf):
            assert tested.limit_step(p, last_rad, bad) == last_rad


def check_ranges(tested: ModuleType) -> None:
    """Check that the settings' ranges are the documents'."""
    angle_max = next(
        one.le
        for one in tested.LimitSettings.model_fields["steer_rad_max"].metadata
        if hasattr(one, "le")
    )
    for key, largest in (("steer_rad_max", angle_max), ("steer_rate_rad_s_max", 1000.0)):
        tested.LimitSettings(**{key: largest})
        tested.LimitSettings(**{key: math.nextafter(0.0, 1.0)})
        for beyond in (0.0, math.nextafter(largest, math.inf)):
            with pytest.raises(ValueError, match=key):
                tested.LimitSettings(**{key: beyond})


def check_fades(tested: ModuleType) -> None:
    """Check that a fade does not jump, ends, and is the new source's at its end."""
    assert (tested.FADE_RAD_S, tested.FADE_M_S, tested.NOTHING) == (0.2, 0.1, (0.0, False, 0.0))
    random = Random(1)
    for _ in range(500):
        step, x = random.choice((0.01, 0.1)), tested.NOTHING
        left = 0.0
        for _ in range(20):
            wanted, source = about(random, 0.1), random.random() < 0.3
            if source is not x.source:
                left = x.value - wanted
            else:
                left = math.copysign(max(abs(left) - step, 0.0), left)
            x = tested.fading_step(step, x, wanted, source)
            assert x.source is source
            assert math.isclose(x.value, wanted + left, abs_tol=1e-12)


@pytest.mark.parametrize(
    ("module", "check"),
    [(steer_limits, check_limits), (fades_and_ramps, check_fades)],
    ids=["limits", "fades"],
)
def test_a_test_notices_every_mutant(
    module: ModuleType, check: Callable[[ModuleType], None]
) -> None:
    assert_noticed(module, check, EQUIVALENT[module.__name__.split(".")[-1]])
