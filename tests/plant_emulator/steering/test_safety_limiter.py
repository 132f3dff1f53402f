"""The safety limiter: its table, its half second, its wheel."""

import math
import random
from bisect import bisect_right

import pytest

from steer_by_wire.plant_emulator.steering import safety_limiter
from steer_by_wire.plant_emulator.vehicle.single_track_model import VehicleParams, state_matrices
from steer_by_wire.plant_emulator.vehicle.steady_turn import acceleration_gain_m_s2

MS_NS = 1_000_000
INF = math.inf


def params(
    angle: float = INF,
    angle_rate: float = INF,
    acceleration: float = INF,
    jerk: float = INF,
    gain: float = 50.0,
) -> safety_limiter.LimiterParams:
    table = safety_limiter.limit_table(gain, angle, angle_rate, acceleration, jerk)
    return safety_limiter.LimiterParams(table, 0.125, 100 * MS_NS, 0.5)


def outputs(
    p: safety_limiter.LimiterParams, commands: list[tuple[float, float]]
) -> list[tuple[float, int]]:
    """Output and cause of each command (time in ms, steer in rad)."""
    x = safety_limiter.start_limiter()
    found = []
    for time_ms, steer_rad in commands:
        x, output = safety_limiter.limit_steer(p, x, steer_rad, round(time_ms * MS_NS))
        assert output == x.steer_rad
        found.append((output, x.cause))
    return found


def test_lateral_acceleration_is_the_angle_by_the_gain() -> None:
    commands = [(0.0, 0.0625), (1.0, 0.0626), (2.0, -0.0625), (3.0, -0.1)]
    assert outputs(params(acceleration=2.0, gain=32.0), commands) == [
        (0.0625, 0),
        (0.0625, 3),
        (-0.0625, 0),
        (-0.0625, 3),
    ]


def test_the_tightest_limit_decides_and_is_the_cause() -> None:
    both = params(angle=0.5, acceleration=2.0, angle_rate=2.0, jerk=INF, gain=32.0)
    assert outputs(both, [(0.0, 3.0)]) == [(0.0625, 3)]
    wide = params(angle=0.5, acceleration=32.0, angle_rate=4.0, gain=32.0)
    assert outputs(wide, [(0.0, 3.0)]) == [(0.5, 1)]
    jerky = params(angle_rate=1.0, jerk=2.0, gain=32.0)
    assert outputs(jerky, [(0.0, 3.0), (1.0, -3.0)]) == [(0.03125, 4), (0.0, 4)]


def test_what_was_is_forgotten_after_the_slot_in_which_half_a_second_has_passed() -> None:
    """Slots end at 250 ms and so on; straight until the first command at 249 or 250 ms."""
    quarter = params(angle_rate=0.5)
    for first_ms, forgotten_ms in ((249.0, 750.0), (250.0, 1000.0)):
        reached = [(first_ms, 0.25), (forgotten_ms - 0.001, 1.0), (forgotten_ms, 1.0)]
        # Straight was held into the slot of the first command: it counts as long as that.
        assert outputs(quarter, reached) == [(0.25, 0), (0.25, 2), (0.5, 2)]


def test_no_two_outputs_within_half_a_second_are_further_apart_than_the_limit() -> None:
    """And a command that is not further from any of the last 0.75 s passes untouched."""
    source = random.Random(11270)
    limit_rad = 0.5 * 5.0 / 50.0
    for scale_rad in (0.03, 0.2):
        p = params(jerk=5.0)
        x = safety_limiter.start_limiter()
        now_ns, kept = 0, [(0, 0.0)]
        for _ in range(600):
            now_ns += source.choice([0, 1, 10, 10, 10, 37, 120]) * MS_NS
            wanted = source.choice([-1.0, 1.0]) * source.uniform(0.0, scale_rad)
            x, output = safety_limiter.limit_steer(p, x, wanted, now_ns)
            # What was in effect at any time of the window: the last before it, and all within.
            recent = _in_effect(kept, now_ns - 500 * MS_NS)
            assert max(abs(output - before) for before in recent) <= limit_rad + 1e-12
            longer = _in_effect(kept, now_ns - 750 * MS_NS)
            if max(abs(wanted - before) for before in longer) <= limit_rad - 1e-12:
                assert (output, x.cause) == (wanted, 0)
            kept.append((now_ns, output))


def _in_effect(kept: list[tuple[int, float]], since_ns: int) -> list[float]:
    first = max(0, bisect_right(kept, (since_ns, INF)) - 1)
    return [steer for _, steer in kept[first:]]


@pytest.mark.parametrize("no_number", [math.nan, INF, -INF])
def test_what_is_no_number_changes_nothing(no_number: float) -> None:
    commands = [(0.0, 0.2), (1.0, no_number), (2.0, 0.3)]
    assert outputs(params(angle=0.7), commands) == [(0.2, 0), (0.2, 5), (0.3, 0)]


# The wheel


def follows(wheel_rad: float, target_rad: float = 0.0) -> bool:
    return safety_limiter.is_at_target(params(), target_rad, wheel_rad)


def test_the_wheels_target_ends_at_the_actuators_stop() -> None:
    for side in (1.0, -1.0):
        assert follows(side * 0.375, side * 2.0)
        assert follows(side * 0.625, side * 2.0)
        assert not follows(side * 0.626, side * 2.0)
        assert not follows(side * 0.374, side * 2.0)
        assert follows(side * 0.25, side * 0.25)
        assert not follows(side * 0.4, side * 0.25)


# The gain


def gain_by_the_matrices(p: VehicleParams) -> float:
    """V times the steady yaw rate per steer: 0 = A x + b for side slip and yaw rate."""
    a, b = state_matrices(p)
    (a11, a12), (a21, a22) = a[:2, :2]
    b1, b2 = b[:2, 0]
    return p.speed_m_s * float((a21 * b1 - a11 * b2) / (a11 * a22 - a12 * a21))


def test_the_gain_is_that_of_the_single_track_model_in_a_steady_turn() -> None:
    """Two derivations: the textbook's understeer gradient, and (1) solved for no change."""
    for speed_m_s in (0.3, 1.4, 5.0, 16.7, 40.0):
        for mass_kg, front, rear in (
            (2000.0, 190e3, 500e3),
            (5000.0, 190e3, 500e3),
            (1600.0, 120e3, 90e3),
        ):
            p = VehicleParams(speed_m_s, mass_kg, 3728.0, front, rear, 1.3008, 1.5453, 1.9)
            if gain_by_the_matrices(p) > 0.0:
                assert acceleration_gain_m_s2(p) == pytest.approx(gain_by_the_matrices(p), rel=1e-9)


def test_without_a_steady_state_the_gain_is_the_neutral_vehicles() -> None:
    """L = 2, K = 1/2 (1/1 - 1/0.2) = -2 by mass 1: critical at 1 m/s."""
    critical = VehicleParams(1.0, 1.0, 1.0, 1.0, 0.2, 1.0, 1.0, 1.0)
    assert acceleration_gain_m_s2(critical) == 0.5
    assert acceleration_gain_m_s2(critical._replace(speed_m_s=2.0)) == 2.0
    almost = 1.0 - 2.0**-22  # the mass just below, where the gain is finite and large
    assert acceleration_gain_m_s2(critical._replace(virtual_mass_kg=almost)) == 2.0**21
    neutral = critical._replace(rear_cornering_stiffness_n_rad=1.0)
    assert acceleration_gain_m_s2(neutral) == 0.5
