"""The hold: commands are followed again without a jump, and only a run of them ends it in time."""

import random
from itertools import product

import pytest

from tests.support.nodes.driven_guard import MS_NS, Guarded, steady

STEP_RAD = 0.005
"""What fades in 10 ms, at 0.5 rad/s; 0.07 in the 140 ms that are no silence."""


def back(guarded: Guarded, first_ms: float, steer_rad: float, number: int) -> list[float]:
    """Take commands every 10 ms; returns the targets."""
    targets = []
    for step in range(number):
        assert guarded.command(first_ms + 10.0 * step, steer_rad)
        targets.append(guarded.target)
    return targets


@pytest.mark.parametrize("silence_ms", [140.0 + 1e-6, 240.0, 400.0, 640.0 - 1e-6])
def test_after_a_hold_of_any_length_nothing_jumps_from_either_side(silence_ms: float) -> None:
    for side in (1.0, -1.0):
        guarded = Guarded()
        steady(guarded, side * 0.25)
        targets = back(guarded, 100.0 + silence_ms, side * -0.25, 120)
        expected = [max(0.25 - STEP_RAD * step, -0.25) for step in range(120)]
        assert [side * target for target in targets] == pytest.approx(expected, abs=1e-9)
        assert targets[-1] == side * -0.25
        assert (guarded.mode, guarded.x.fade_rad) == ("FOLLOWING", 0.0)


def test_a_silence_in_the_run_starts_it_anew_and_only_the_fade_goes_on() -> None:
    """By what fades in 140 ms, towards the command before; the newest moves nothing."""
    for side in (1.0, -1.0):
        guarded = Guarded()
        steady(guarded, side * 0.25)
        guarded.command(300.0, 0.0)
        guarded.command(310.0, 0.0)
        assert guarded.command(450.0, side * -0.5)
        assert (guarded.mode, guarded.x.good_run) == ("HOLDING", 1)
        assert side * guarded.target == pytest.approx(0.245 - 0.07)
        assert side * guarded.x.fade_rad == pytest.approx(0.245 - 0.07 + 0.5)
        assert guarded.command(650.0, side * -0.5)
        assert side * guarded.target == pytest.approx(0.245 - 0.14)


# The clock


def test_the_clock_stands_while_commands_are_no_older_than_what_is_no_silence() -> None:
    """One command every 300 ms: 160 ms of each are silence, and 500 are up in the fourth."""
    guarded = Guarded()
    guarded.command(0.0, 0.25)
    for time_ms, deadline_ms in ((300.0, 780.0), (600.0, 920.0), (900.0, 1060.0)):
        assert guarded.command(time_ms, 0.25)
        assert (guarded.mode, guarded.x.deadline_ns) == ("HOLDING", deadline_ms * MS_NS)
    guarded.until(1060.0 - 1e-6)
    assert guarded.mode == "HOLDING"
    guarded.until(1060.0)
    assert guarded.mode == "FALLBACK"


@pytest.mark.parametrize("recovery_frames", [1, 2, 3])
def test_recovery_comes_as_soon_as_so_many_more_commands_were_good_than_damaged(
    recovery_frames: int,
) -> None:
    """Every order of eight frames: good less damaged ones, counted from any of them on."""
    guarded = Guarded(recovery_frames=recovery_frames)
    steady(guarded, 0.25)
    guarded.until(1000.0)
    guarded.damaged()
    fallen_back = guarded.x
    for order in product((1, -1), repeat=8):
        guarded.x = fallen_back
        most, time_ms = 0, 1000.0
        for gain in order:
            most = max(most + gain, 0)
            if gain < 0:
                guarded.damaged()
            else:
                time_ms += 10.0
                guarded.command(time_ms, 0.25)
            assert (guarded.mode == "FALLBACK") == (most < recovery_frames)
            if guarded.mode != "FALLBACK":
                break


def test_whatever_comes_fallback_comes_in_silence_and_no_step_is_more_than_fade_and_command() -> (
    None
):
    source = random.Random(3)
    fallbacks = 0
    for _ in range(40):
        guarded = Guarded(recovery_frames=source.choice([1, 2, 5]))
        time_ms, steer_rad, gap_ms = 0.0, 0.0, 0.0
        guarded.command(time_ms, steer_rad)
        for _ in range(40):
            gap_ms = source.choice([10.0, 80.0, 139.0, 141.0, 180.0, 250.0])
            arrived_ms, time_ms = time_ms, time_ms + gap_ms
            guarded.until(time_ms - 1e-6)
            if guarded.mode == "FALLBACK":
                fallbacks += 1
                assert guarded.log[-1][1] == "FALLBACK"
                assert all(at >= arrived_ms + 140.0 for at, *_ in guarded.log[-1:])
                break
            before, wanted_rad = guarded.target, source.uniform(-0.5, 0.5)
            guarded.command(time_ms, wanted_rad)
            change = 0.0 if gap_ms > 140.0 else abs(wanted_rad - steer_rad)
            faded = 0.5 * 1e-3 * min(gap_ms, 140.0)
            assert abs(guarded.target - before) <= change + faded + 1e-9
            steer_rad = wanted_rad
    assert fallbacks > 10


# Plans


def test_a_plan_is_played_for_its_time_and_until_the_fallback() -> None:
    guarded = Guarded(plan_ms=300.0)
    steady(guarded, 0.25)
    assert guarded.plan_value(400.0, 0.2)
    assert not guarded.plan_value(400.0 + 1e-6, 0.1)
    assert guarded.target == 0.2
    guarded = Guarded(plan_ms=10_000.0)
    steady(guarded, 0.25)
    guarded.until(740.0)
    before = guarded.x
    assert not guarded.plan_value(740.0, 0.2)
    assert (guarded.mode, guarded.x) == ("FALLBACK", before)
    guarded = Guarded(override_ms=50.0)
    guarded.command(0.0, 0.25)
    assert not guarded.plan_value(60.0, 0.2)


def test_the_fade_goes_on_through_the_values_of_a_plan_and_the_command_after_them() -> None:
    for side in (1.0, -1.0):
        guarded = Guarded()
        steady(guarded, side * 0.25)
        assert guarded.command(300.0, 0.0)
        for step in range(1, 5):
            assert guarded.plan_value(300.0 + 10.0 * step, side * 0.125)
            assert side * guarded.target == pytest.approx(0.375 - STEP_RAD * step)
        assert (guarded.mode, guarded.x.good_run, guarded.x.arrived_ns) == (
            *("HOLDING", 1),
            300 * MS_NS,
        )
        assert guarded.command(350.0, side * 0.125)
        assert side * guarded.target == pytest.approx(0.375 - 5 * STEP_RAD)
