"""A test notices every mutant of the controller's limits, ramps and fades."""

import math
from collections.abc import Callable
from random import Random
from types import ModuleType

import pytest

from steer_by_wire.controller.limits import fades_and_ramps, steer_limits
from tests.support.mutation import survivors

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
    "fades_and_ramps": {
        "value > step  ->  value >= step",
        "value < -step  ->  value <= -step",
    },
}
"""What behaves as the original for all numbers."""
SHARES = (0.0, 1e-9, 0.5, 1.0, 1.0 + 1e-9, 2.0, 10.0)


def about(random: Random, scale: float) -> float:
    """Return a number at, beside or far from a bound."""
    return random.choice((-1.0, 1.0)) * random.choice(SHARES) * scale


def limits_are_broken(mutant: ModuleType) -> bool:
    """Return whether a limited command is not the nearest of those that are allowed."""
    table = mutant.LimitSettings()
    if mutant.steer_limits_of(table, 10_000_000) != (0.6, 0.02):
        return True
    if (table.steer_rad_max, table.steer_rate_rad_s_max) != (0.6, 2.0) or is_wrong_range(mutant):
        return True
    random = Random(1)
    for _ in range(2000):
        p = mutant.SteerLimits(random.choice((0.5, 0.6)), random.choice((0.1, 0.5, 2.0)))
        last_rad = max(-p.steer_rad_max, min(about(random, p.steer_rad_max), p.steer_rad_max))
        wanted_rad = last_rad + about(random, p.step_rad_max)
        wanted_rad = random.choice((wanted_rad, about(random, p.steer_rad_max)))
        low_rad, high_rad = last_rad - p.step_rad_max, last_rad + p.step_rad_max
        by_hand = sorted((low_rad, wanted_rad, high_rad))[1]
        by_hand = sorted((-p.steer_rad_max, by_hand, p.steer_rad_max))[1]
        sent_rad = mutant.limit_step(p, last_rad, wanted_rad)
        is_at_angle = by_hand in (p.steer_rad_max, -p.steer_rad_max)
        if sent_rad != by_hand or (mutant.limit_name(p, by_hand) == "angle") != is_at_angle:
            return True
    return any(mutant.limit_step(p, 0.1, bad) != 0.1 for bad in (math.nan, math.inf))


def is_wrong_range(mutant: ModuleType) -> bool:
    """Return whether the settings' ranges are others than the documents'."""
    angle_max = next(
        one.le
        for one in mutant.LimitSettings.model_fields["steer_rad_max"].metadata
        if hasattr(one, "le")
    )
    for key, least, largest in (
        ("steer_rad_max", 0.0, angle_max),
        ("steer_rate_rad_s_max", 0.0, 1000.0),
    ):
        mutant.LimitSettings(**{key: largest})
        mutant.LimitSettings(**{key: math.nextafter(least, 1.0)})
        for beyond in (least, math.nextafter(largest, math.inf)):
            try:
                mutant.LimitSettings(**{key: beyond})
            except ValueError:
                continue
            return True
    return False


def fades_are_broken(mutant: ModuleType) -> bool:
    """Return whether a fade jumps, does not end, or is not the new source's at its end."""
    if (mutant.FADE_RAD_S, mutant.FADE_M_S, mutant.NOTHING) != (0.2, 0.1, (0.0, False, 0.0)):
        return True
    random = Random(1)
    for _ in range(500):
        step, x = random.choice((0.01, 0.1)), mutant.NOTHING
        left = 0.0
        for _ in range(20):
            wanted, source = about(random, 0.1), random.random() < 0.3
            if source is not x.source:
                left = x.value - wanted
            else:
                left = math.copysign(max(abs(left) - step, 0.0), left)
            x = mutant.fading_step(step, x, wanted, source)
            if x.source is not source or not math.isclose(x.value, wanted + left, abs_tol=1e-12):
                return True
    return False


def fails(is_broken: Callable[[ModuleType], bool]) -> Callable[[ModuleType], bool]:
    """Return the same, where an exception counts too."""

    def is_killed(mutant: ModuleType) -> bool:
        try:
            return is_broken(mutant)
        except Exception:
            return True

    return is_killed


@pytest.mark.parametrize(
    ("module", "is_broken"),
    [(steer_limits, limits_are_broken), (fades_and_ramps, fades_are_broken)],
    ids=["limits", "fades"],
)
def test_a_test_notices_every_mutant(
    module: ModuleType, is_broken: Callable[[ModuleType], bool]
) -> None:
    alive, count = survivors(module, fails(is_broken))
    assert {text.split(": ")[1] for text in alive} == EQUIVALENT[module.__name__.split(".")[-1]]
    assert count >= 30
