"""The guard: silence, fallback, recovery and safe state."""

import math

import pytest

from steer_by_wire.plant_emulator.steering import hold_and_fallback, safety_limiter
from tests.support.nodes.driven_guard import MODES, MS_NS, Guarded, steady


def test_before_the_first_command_nothing_is_due() -> None:
    guarded = Guarded()
    assert guarded.x == (0, safety_limiter.start_limiter(), 0, 2**62, 0, 0.0, 0)
    guarded.until(1e6)
    assert guarded.log == []
    assert guarded.command(1e6, 0.25)
    assert (guarded.mode, guarded.target) == ("FOLLOWING", 0.25)


def test_commands_that_keep_coming_are_followed_as_they_are() -> None:
    guarded = Guarded()
    for step in range(200):
        steer_rad = 0.3 * math.sin(0.1 * step)
        assert guarded.command(140.0 * step, steer_rad)
        assert guarded.target == steer_rad
    assert guarded.mode == "FOLLOWING"
    assert guarded.log == []
    newest_ns = 199 * 140 * MS_NS
    assert guarded.x[2:] == (newest_ns, newest_ns + 140 * MS_NS, 0, 0.0, newest_ns)


def test_silence_is_held_then_ramped_to_zero_and_there_it_ends() -> None:
    guarded = Guarded()
    steady(guarded, 0.0625 + 0.015625)
    guarded.until(1e5)
    assert guarded.log == [
        (240.0, "HOLDING", 0.078125),
        (740.0, "FALLBACK", 0.046875),
        (750.0, "FALLBACK", 0.015625),
        (760.0, "FALLBACK", 0.0),
    ]
    assert guarded.set_anew == [False, True, True, True]
    assert guarded.x.deadline_ns == 2**62


def test_a_fallback_may_keep_the_wheel_where_it_is() -> None:
    guarded = Guarded(ramp_step_rad=0.0)
    steady(guarded, 0.25)
    guarded.until(1e5)
    assert guarded.log == [(240.0, "HOLDING", 0.25), (740.0, "FALLBACK", 0.25)]
    assert guarded.x.deadline_ns == 2**62


def test_a_later_silence_finds_no_fade_and_no_run_of_an_earlier_one() -> None:
    guarded = Guarded(recovery_frames=2, ramp_step_rad=0.0)
    steady(guarded, 0.25)
    guarded.command(800.0, 0.0)
    guarded.command(810.0, 0.0)
    assert guarded.x.fade_rad == 0.25
    guarded.until(1000.0)
    assert (guarded.mode, guarded.x.fade_rad, guarded.x.good_run) == ("HOLDING", 0.25, 1)
    guarded.until(1500.0)
    assert (guarded.mode, guarded.x.fade_rad, guarded.x.good_run) == ("FALLBACK", 0.0, 1)
    assert not guarded.command(1500.0, 0.125)
    assert guarded.x.fade_rad == 0.0
    assert guarded.command(1510.0, 0.125)
    assert (guarded.target, guarded.x.fade_rad) == (0.25, 0.125)


# The safe state


def test_a_wheel_that_does_not_follow_makes_the_safe_state_due_at_once_and_for_good() -> None:
    guarded = Guarded()
    for step in range(11):
        guarded.command(10.0 * step, 0.25)
        guarded.wheel(10.0 * step, 0.25 if step < 1 else 0.0)
    assert guarded.mode == "FOLLOWING"
    guarded.wheel(100.0 + 1e-6, 0.0)
    assert (guarded.mode, guarded.x.deadline_ns) == ("SAFE_STATE", 100 * MS_NS + 1)
    assert not guarded.command(100.0 + 1e-6, 0.25)
    guarded.wheel(100.0 + 1e-6, 0.0)
    guarded.until(200.0)
    assert [target for _, _, target in guarded.log] == [
        0.25 - 0.03125 * step for step in range(1, 9)
    ]
    assert {mode for _, mode, _ in guarded.log} == {"SAFE_STATE"}
    before = guarded.x
    for step in range(20):
        assert not guarded.command(1000.0 + 10.0 * step, 0.25)
    assert guarded.x == before


def test_a_fault_of_its_own_makes_the_safe_state_due_at_once_in_every_mode_and_for_good() -> None:
    for until_ms, mode in ((0.0, "FOLLOWING"), (240.0, "HOLDING"), (741.0, "FALLBACK")):
        guarded = Guarded(recovery_frames=2)
        steady(guarded, 0.25)
        guarded.until(until_ms)
        assert guarded.mode == mode
        limiter, at_ns = guarded.x.limiter, 760 * MS_NS
        guarded.x = hold_and_fallback.guard_fault(guarded.x, at_ns)
        assert guarded.x == (4, limiter, 100 * MS_NS, at_ns, 0, 0.0, at_ns)
        assert not guarded.command(760.0 - 1e-6, 0.25)
        before = guarded.target
        guarded.until(760.0)
        assert guarded.log[-1] == (760.0, "SAFE_STATE", before - 0.03125)
        safe = guarded.x
        assert hold_and_fallback.guard_fault(safe, 761 * MS_NS) is safe


@pytest.mark.parametrize("override_ms", [50.0, 105.0, 245.0, 300.0, 735.0, 755.0])
def test_an_override_is_obeyed_in_every_mode(override_ms: float) -> None:
    guarded = Guarded(override_ms=override_ms)
    for time_ms in range(0, min(101, round(override_ms)), 10):
        guarded.command(time_ms, 10.0)
    guarded.until(override_ms - 1e-6)
    assert guarded.mode != "SAFE_STATE"
    before = guarded.target
    guarded.until(override_ms)
    assert guarded.mode == "SAFE_STATE"
    assert guarded.log[-1] == (override_ms, "SAFE_STATE", before - 0.03125)
    assert not guarded.command(override_ms + 1.0, 1.0)
    guarded.until(override_ms + 10.0)
    assert guarded.log[-1] == (override_ms + 10.0, "SAFE_STATE", before - 0.0625)


def test_a_command_is_overruled_unless_it_is_followed_as_it_is() -> None:
    x = Guarded().x
    for mode, name in enumerate(MODES):
        for cause in (0, 1, 2, 5):
            for fade_rad in (0.0, 1e-6, -1e-6, 0.5, -0.5):
                limiter = x.limiter._replace(cause=cause)
                state = x._replace(mode=mode, limiter=limiter, fade_rad=fade_rad)
                if name == "FOLLOWING":
                    expected = cause != 0 or fade_rad != 0.0
                else:
                    expected = name != "NO_COMMAND"
                assert hold_and_fallback.is_overruled(state) is expected
