"""A test notices every mutant of the steering's guard."""

from types import ModuleType

from steer_by_wire.plant_emulator.steering import hold_and_fallback
from tests.plant_emulator.steering import test_hold_and_fallback, test_steering_hold
from tests.support.nodes import driven_guard
from tests.support.suite.mutation import assert_noticed, run_tests

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


def check(tested: ModuleType) -> None:
    for suite in (test_hold_and_fallback, test_steering_hold):
        run_tests(suite, tested, driven_guard)


def test_a_test_notices_every_mutant() -> None:
    assert_noticed(hold_and_fallback, check, EQUIVALENT)
