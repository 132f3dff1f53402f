"""The rack: friction against its paper, closed forms, energy, and the car that it steers."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.plant_emulator.settings import plant_motion_params, plant_preset
from steer_by_wire.plant_emulator.vehicle.car.rack import (
    RACK_AT_REST,
    RackParams,
    RackState,
    rack_step,
)
from steer_by_wire.plant_emulator.vehicle.car.rack_friction import FrictionParams, moved, steady_n_m
from steer_by_wire.plant_emulator.vehicle.car.rack_settings import RackSettings, rack_params
from steer_by_wire.plant_emulator.vehicle.car.steering_input import SteeringInput
from steer_by_wire.plant_emulator.vehicle.exact_propagation import DELTA
from steer_by_wire.plant_emulator.vehicle.moving_vehicle import Motion
from steer_by_wire.plant_emulator.vehicle.settings import ActuatorSettings, VehicleSettings
from steer_by_wire.runtime.settings import SettingsError

MS = 1_000_000
H_S = 1e-3
PAPER = FrictionParams(1.0, 1.5, 1e5, math.sqrt(1e5), 1e-3)
"""Table I of the paper of 1995, for a mass of 1 kg with a viscous friction of 0.4 N s/m."""
SERVO = ActuatorSettings(lag_s=0.05, rate_limit_rad_s=5.0, angle_limit_rad=1.0)
FREE = SteeringInput(0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0)


def params(actuator: ActuatorSettings = SERVO, **rack: object) -> RackParams:
    return rack_params(RackSettings.model_validate(rack), actuator, VehicleSettings())


def pulled(force_n: Callable[[float], float], end_s: float, h_s: float) -> Sequence[list[float]]:
    """Pull the paper's mass; returns force, place, speed and bristles at every step."""
    place_m = v = bristle_m = 0.0
    rows = []
    for step in range(round(end_s / h_s)):
        now_n = force_n(step * h_s)
        v, bristle_m = moved(PAPER, 1.0, 0.4, now_n, v, bristle_m, h_s)
        place_m += h_s * v
        rows.append([now_n, place_m, v, bristle_m])
    return np.array(rows).T


def test_bristles_give_the_papers_hysteresis_before_sliding() -> None:
    """Its figure 2: to 1.425 N and back to -1.425 N, in closed form where the mass does not count.

    F = F_s (1 - exp(-σ0 x/F_s)) on the way out, mirrored about the turning point on the way back.
    """
    top_n, span_m = 1.425, 1.5 / 1e5
    force_n, place_m, _, _ = pulled(lambda t: top_n - abs(top_n - 0.3 * t), 14.0, 1e-3)
    turn = int(np.argmax(force_n))
    out_m = -span_m * math.log(1.0 - top_n / 1.5)
    assert place_m[turn] == pytest.approx(out_m, rel=0.02)
    back = int(np.argmin(np.abs(force_n[turn:]))) + turn
    back_m = out_m - span_m * math.log((1.5 + top_n) / 1.5)
    assert place_m[back] == pytest.approx(back_m, rel=0.02)


def test_bristles_break_away_at_the_static_friction_when_pulled_slowly() -> None:
    """The paper's section on break-away: F_s for a force that grows by 0.5 N/s."""
    force_n, _, v, _ = pulled(lambda t: 0.5 * t, 3.2, 1e-3)
    assert force_n[int(np.argmax(v > PAPER.stribeck_rad_s))] == pytest.approx(1.5, rel=0.02)


@given(st.floats(-0.01, 0.01))
def test_steady_sliding_is_stribecks_curve(rate_rad_s: float) -> None:
    exact = 1.0 + 0.5 * math.exp(-((rate_rad_s / 1e-3) ** 2))
    assert steady_n_m(PAPER, rate_rad_s) == pytest.approx(exact, abs=2e-6)


@given(st.booleans(), st.lists(st.floats(-30.0, 30.0), min_size=2, max_size=60))
def test_friction_creates_no_energy(is_lugre: bool, moments_n_m: list[float]) -> None:
    """Kinetic energy and that of the bristles grow by no more than the moments' work."""
    friction = params(friction="lugre" if is_lugre else "coulomb", static_share=1.5).friction
    rate = bristle = 0.0
    for moment_n_m in moments_n_m:
        before_j = 0.5 * 4.0 * rate**2 + 0.5 * friction.bristle_n_m * bristle**2
        rate, bristle = moved(friction, 4.0, 20.0, moment_n_m, rate, bristle, H_S)
        after_j = 0.5 * 4.0 * rate**2 + 0.5 * friction.bristle_n_m * bristle**2
        work_j = moment_n_m * rate * H_S
        assert after_j - before_j <= work_j + 1e-12 * (1.0 + before_j)


@given(
    st.floats(-8000.0, 8000.0),
    st.floats(0.0, 1.2),
    st.floats(-1.0, 1.0),
    st.floats(-3.0, 3.0),
    st.floats(-0.3, 0.3),
)
def test_the_play_gives_the_rack_no_more_than_tyres_give_it(
    force_n: float, use: float, side: float, rate: float, command: float
) -> None:
    p = params(play_rad=0.006)
    x = RACK_AT_REST._replace(gap_rad=max(-0.006, min(0.006, 0.008 * side)), wheel_rate_rad_s=rate)
    acts = FREE._replace(command_rad=command, front_lateral_n=force_n, front_use=use)
    after = rack_step(p, x, acts, H_S)
    rest = max(1.0 - use, 0.0)
    trail_m = 0.02 + 0.03 * rest**3 / (rest + min(use, 1.0) ** 2 / 3.0)
    wheels_rad = after.road_rad - (x.rack_rad + x.gap_rad)
    given_j = -force_n * trail_m * wheels_rad
    taken_j = after.rack_force_n * 0.14 * (after.rack_rad - x.rack_rad)
    assert taken_j <= given_j + 1e-9


def test_a_rack_without_current_only_loses_speed() -> None:
    p, x = params(), RACK_AT_REST._replace(wheel_rate_rad_s=1.0)
    rates = []
    for _ in range(2000):
        x = rack_step(p, x, FREE._replace(torque_share=0.0, command_rad=0.5), H_S)
        rates.append(x.wheel_rate_rad_s)
    assert rates == sorted(rates, reverse=True)
    assert rates[-1] == 0.0


@pytest.mark.parametrize("windings", [1.0, 2.0])
@pytest.mark.parametrize("side_n", [0.0, 1500.0])
def test_the_rate_falls_with_the_load_as_the_voltage_says(side_n: float, windings: float) -> None:
    """k (U - k ω)/R = d ω + c ω + M_c + the moment of the caster, in steady motion."""
    p = params(ActuatorSettings(lag_s=0.005, rate_limit_rad_s=50.0))
    acts = FREE._replace(command_rad=1.4, front_lateral_n=side_n, front_use=1.0)
    acts, x = acts._replace(resistance_factor=windings), RACK_AT_REST
    while x.rack_rad < 0.7:
        x = rack_step(p, x, acts, H_S)
    k, ohm = p.motor_n_m_a, windings * p.resistance_ohm
    load_n_m = p.friction.coulomb_n_m + side_n * p.caster_trail_m
    damping = p.damping_n_m_s + p.wheel_damping_n_m_s + k * k / ohm
    assert x.wheel_rate_rad_s == pytest.approx((k * 12.0 / ohm - load_n_m) / damping, rel=1e-3)
    assert x.is_limited


def test_the_coulomb_force_is_that_of_the_measured_cars() -> None:
    """At 0.141 m/s² of lateral acceleration the aligning torque just overcomes it."""
    p, vehicle = params(torque_n_m_a=0.05), VehicleSettings()
    rear_m = vehicle.rear_axle_distance_m
    front = rear_m / (vehicle.front_axle_distance_m + rear_m)
    for a_y, is_held in ((0.140, True), (0.142, False)):
        side_n = -a_y * vehicle.virtual_mass_kg * front
        acts = FREE._replace(torque_share=0.0, front_lateral_n=side_n)
        x = rack_step(p, RACK_AT_REST, acts, H_S)
        assert (x.wheel_rate_rad_s == 0.0) == is_held


def settled(p: RackParams, acts: SteeringInput, seconds: float = 3.0) -> RackState:
    x = RACK_AT_REST
    for _ in range(round(seconds / H_S)):
        x = rack_step(p, x, acts, H_S)
    return x


def test_the_aligning_torque_vanishes_at_the_limit_but_for_the_caster() -> None:
    for use, trail_m in ((0.0, 0.05), (0.5, 0.02 + 0.03 * 0.125 / (0.5 + 0.25 / 3.0)), (1.1, 0.02)):
        x = settled(params(), FREE._replace(front_lateral_n=2000.0, front_use=use))
        assert x.rack_force_n == pytest.approx(-2000.0 * trail_m / 0.14, rel=1e-6)
        assert abs(x.wheel_rad) < 1e-4  # the integral holds it


def test_a_sensor_that_errs_turns_the_wheels_and_does_not_show() -> None:
    x = settled(params(), FREE._replace(command_rad=0.1, sensor_rad=0.02))
    assert x.wheel_rad == pytest.approx(0.1, abs=1e-4)
    assert x.road_rad == pytest.approx(0.08, abs=1e-4)


@pytest.mark.parametrize("preset", ["bmw_320i", "paper_nominal"])
def test_a_command_acts_after_the_dead_time(preset: str) -> None:
    """As the same command given later, off the grid of milliseconds; the commands overlap."""
    dead_ns = 37_500_001
    at_once, late = (
        Motion(plant_motion_params(plant_preset(preset, ["actuator.lag_s=0.05", dead])))
        for dead in ("actuator.dead_time_s=0", "actuator.dead_time_s=0.037500001")
    )
    for tick in range(50):
        at_ns = tick * 10 * MS
        late.advance(at_ns)
        late.command(0.01 * math.sin(tick))
        at_once.advance(at_ns + dead_ns)
        at_once.command(0.01 * math.sin(tick))
    late.advance(at_once.time_ns)
    assert late.linear == pytest.approx(at_once.linear, rel=1e-9, abs=1e-15)
    assert late.linear[DELTA] != 0.0


@pytest.mark.parametrize(
    ("name", "lag_s", "dead_time_s", "rate_rad_s"),
    [
        ("autoware", 0.27, 0.24, 5.0),
        ("aiformula", 0.12, 0.04, math.radians(80.0)),
        ("open_car_dynamics", 0.06, 0.0, 0.5),
    ],
)
def test_a_published_actuator_replaces_that_of_a_preset(
    name: str, lag_s: float, dead_time_s: float, rate_rad_s: float
) -> None:
    """It drives, and its wheel reaches 1 - 1/e of a small step after dead time and lag."""
    settings = plant_preset("bmw_320i", [f"actuator.published={name}", "path={kind='straight'}"])
    assert settings.actuator.rate_limit_rad_s == pytest.approx(rate_rad_s, rel=1e-3)
    motion = Motion(plant_motion_params(settings))
    motion.command(0.001)
    motion.advance(round((dead_time_s + lag_s) * 1e9))
    assert motion.linear[DELTA] == pytest.approx(0.001 * (1.0 - math.exp(-1.0)), rel=0.01)


def test_a_rack_without_a_position_loop_is_refused() -> None:
    with pytest.raises(SettingsError, match=r"car\.rack needs actuator\.lag_s of 0\.005 to 10"):
        plant_preset("bmw_320i", ["car.rack={}", "actuator.lag_s=0"])


def test_friction_that_would_create_energy_is_refused() -> None:
    with pytest.raises(SettingsError, match="friction would create energy"):
        plant_preset("bmw_320i", ["car.rack={friction='lugre', static_share=4}"])
