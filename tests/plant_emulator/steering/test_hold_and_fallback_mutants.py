"""A test notices every mutant of the steering's guard."""

from importlib import import_module

from steer_by_wire.plant_emulator.steering import hold_and_fallback
from tests.support import driven_guard
from tests.support.mutation import fails_with, survivors

EQUIVALENT = {
    # SAFE_STATE is the greatest mode.
    "x.mode == _SAFE_STATE  ->  x.mode >= _SAFE_STATE",
    "before == _SAFE_STATE  ->  before >= _SAFE_STATE",
    "mode != _SAFE_STATE  ->  mode < _SAFE_STATE",
    # SAFE_STATE is dealt with before, and FALLBACK in the same breath.
    "before == _FALLBACK  ->  before >= _FALLBACK",
    "before == _HOLDING  ->  before >= _HOLDING",
    # FOLLOWING is dealt with before; a cause is not negative.
    "x.mode > _FOLLOWING  ->  x.mode >= _FOLLOWING",
    "x.limiter.cause != 0  ->  x.limiter.cause > 0",
    # A run grows by one, so it meets the number before it exceeds it, and is not negative.
    "good_run >= p.recovery_frames  ->  good_run == p.recovery_frames",
    "run_before > 0  ->  run_before != 0",
    # A step of a ramp is not negative.
    "p.ramp_step_rad > 0.0  ->  p.ramp_step_rad != 0.0",
}
"""What behaves as the original in all states there are."""


def test_a_test_notices_every_mutant() -> None:
    folder = "tests.plant_emulator.steering"
    names = ("test_hold_and_fallback", "test_steering_hold")
    suites = [import_module(f"{folder}.{name}") for name in names]
    alive, count = survivors(
        hold_and_fallback,
        lambda mutant: any(fails_with(suite, mutant, "", driven_guard) for suite in suites),
    )
    assert {text.split(": ")[1] for text in alive} == EQUIVALENT
    assert count > 80
