"""The limits, ramps and fades of the controller against rules written apart."""

import math
from random import Random

import pytest

from steer_by_wire.controller.limits import fades_and_ramps, steer_limits

SHARES = (0.0, 1e-9, 0.5, 1.0, 1.0 + 1e-9, 2.0, 10.0)


def about(random: Random, scale: float) -> float:
    """Return a number at, beside or far from a bound."""
    return random.choice((-1.0, 1.0)) * random.choice(SHARES) * scale


def test_a_limited_command_is_the_nearest_allowed() -> None:
    table = steer_limits.LimitSettings()
    assert steer_limits.steer_limits_of(table, 10_000_000) == (0.6, 0.02)
    assert (table.steer_rad_max, table.steer_rate_rad_s_max) == (0.6, 2.0)
    random = Random(1)
    for _ in range(2000):
        p = steer_limits.SteerLimits(random.choice((0.5, 0.6)), random.choice((0.1, 0.5, 2.0)))
        last_rad = max(-p.steer_rad_max, min(about(random, p.steer_rad_max), p.steer_rad_max))
        wanted_rad = last_rad + about(random, p.step_rad_max)
        wanted_rad = random.choice((wanted_rad, about(random, p.steer_rad_max)))
        low_rad, high_rad = last_rad - p.step_rad_max, last_rad + p.step_rad_max
        by_hand = sorted((low_rad, wanted_rad, high_rad))[1]
        by_hand = sorted((-p.steer_rad_max, by_hand, p.steer_rad_max))[1]
        assert steer_limits.limit_step(p, last_rad, wanted_rad) == by_hand
        is_at_angle = by_hand in (p.steer_rad_max, -p.steer_rad_max)
        assert (steer_limits.limit_name(p, by_hand) == "angle") == is_at_angle
        for bad in (math.nan, math.inf, -math.inf):
            assert steer_limits.limit_step(p, last_rad, bad) == last_rad


def test_the_settings_ranges_are_the_documents() -> None:
    angle_max = next(
        one.le
        for one in steer_limits.LimitSettings.model_fields["steer_rad_max"].metadata
        if hasattr(one, "le")
    )
    for key, largest in (("steer_rad_max", angle_max), ("steer_rate_rad_s_max", 1000.0)):
        steer_limits.LimitSettings(**{key: largest})
        steer_limits.LimitSettings(**{key: math.nextafter(0.0, 1.0)})
        for beyond in (0.0, math.nextafter(largest, math.inf)):
            with pytest.raises(ValueError, match=key):
                steer_limits.LimitSettings(**{key: beyond})


def test_a_fade_does_not_jump_and_ends_at_the_new_source() -> None:
    assert (fades_and_ramps.FADE_RAD_S, fades_and_ramps.FADE_M_S, fades_and_ramps.NOTHING) == (
        0.2,
        0.1,
        (0.0, False, 0.0),
    )
    random = Random(1)
    for _ in range(500):
        step, x = random.choice((0.01, 0.1)), fades_and_ramps.NOTHING
        left = 0.0
        for _ in range(20):
            wanted, source = about(random, 0.1), random.random() < 0.3
            if source is not x.source:
                left = x.value - wanted
            else:
                left = math.copysign(max(abs(left) - step, 0.0), left)
            x = fades_and_ramps.fading_step(step, x, wanted, source)
            assert x.source is source
            assert math.isclose(x.value, wanted + left, abs_tol=1e-12)
