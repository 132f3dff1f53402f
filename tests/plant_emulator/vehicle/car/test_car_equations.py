"""The car's equations: against a published model, in closed form, and by its energy."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.plant_emulator.path.portable_trigonometry import arctan, cos_sin
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.plant_emulator.vehicle.car.car_design import car_params
from steer_by_wire.plant_emulator.vehicle.car.car_step import (
    CarInput,
    CarParams,
    CarState,
    car_step,
)
from steer_by_wire.plant_emulator.vehicle.car.settings import CarSettings
from steer_by_wire.plant_emulator.vehicle.car.steady_state import steady_turn
from steer_by_wire.plant_emulator.vehicle.car.tyre import TyreParams, lateral_n
from steer_by_wire.plant_emulator.vehicle.settings import VehicleSettings
from steer_by_wire.plant_emulator.vehicle.steady_turn import steady_steer_m

CARS = ("bmw_320i", "ford_escort", "large_sedan", "honda_civic", "city_bus", "f1tenth")
REST = CarState(*[0.0] * len(CarState._fields))


def free_of_drag(name: str, **changes: Any) -> tuple[PlantSettings, CarSettings]:
    settings = plant_preset(name)
    assert settings.car is not None
    changes = {"drag_n_s2_m2": 0.0, "rolling_resistance": 0.0, **changes}
    return settings, settings.car.model_copy(update=changes)


def single_track_of_commonroad(
    p: CarParams, speed: float, a_x: float, delta: float, r: float, beta: float
) -> tuple[float, float]:
    """β' and r' of vehicle_dynamics_st.py (commonroad-vehicle-models 3.0.2), line by line.

    There μ C_S F_z is the stiffness of an axle; here the stiffness over its load.
    """
    g = (p.front_load_n + p.rear_load_n) / p.mass_kg
    lf, lr, m, inertia = p.front_axle_m, p.rear_axle_m, p.mass_kg, 1.0 / p.yaw_inertia_1_kg_m2
    h = p.load_shift_kg * (lf + lr) / m
    csf, csr = p.front.stiffness_1_rad, p.rear.stiffness_1_rad
    front, rear = g * lr - a_x * h, g * lf + a_x * h
    r_rate = (
        -m / (speed * inertia * (lr + lf)) * (lf**2 * csf * front + lr**2 * csr * rear) * r
        + m / (inertia * (lr + lf)) * (lr * csr * rear - lf * csf * front) * beta
        + m / (inertia * (lr + lf)) * lf * csf * front * delta
    )
    beta_rate = (
        (1.0 / (speed**2 * (lr + lf)) * (csr * rear * lr - csf * front * lf) - 1.0) * r
        - 1.0 / (speed * (lr + lf)) * (csr * rear + csf * front) * beta
        + 1.0 / (speed * (lr + lf)) * csf * front * delta
    )
    return beta_rate, r_rate


@given(
    st.sampled_from(CARS),
    st.floats(1.0, 40.0),
    st.floats(-3.0, 3.0),
    st.lists(st.sampled_from((-1.0, -0.3, 0.2, 0.7)), min_size=3, max_size=3),
)
def test_small_motion_is_that_of_a_published_single_track(
    name: str, speed: float, a_x: float, parts: list[float]
) -> None:
    """To 12 digits: with the slips of steady rolling, and so small that tyres are linear."""
    settings, car = free_of_drag(name)
    p = car_params(settings.vehicle, car, gravity_m_s2=9.81)
    delta, r, beta = (1e-15 * part for part in parts)
    v, h_s = speed * beta, 1e-4
    slips = delta - (v + p.front_axle_m * r) / speed, -(v - p.rear_axle_m * r) / speed
    before = REST._replace(
        speed_m_s=speed,
        lateral_speed_m_s=v,
        yaw_rate_rad_s=r,
        front_slip=slips[0],
        rear_slip=slips[1],
        longitudinal_m_s2=a_x,
    )
    after = car_step(p, before, CarInput(delta, 0.0, 0.0, 0.0, 1.0, 0.0), h_s)
    beta_rate, r_rate = single_track_of_commonroad(p, speed, a_x, delta, r, beta)
    scale = 1e-15 * (p.front.stiffness_1_rad + p.rear.stiffness_1_rad) * 10.0
    assert (after.lateral_speed_m_s - v) / h_s == pytest.approx(
        speed * beta_rate, rel=1e-12, abs=1e-12 * scale
    )
    assert (after.yaw_rate_rad_s - r) / h_s == pytest.approx(
        r_rate, rel=1e-12, abs=1e-12 * scale * p.mass_kg * p.front_axle_m * p.yaw_inertia_1_kg_m2
    )


def turned(p: CarParams, speed: float, steer: float, seconds: float = 12.0) -> CarState:
    """Drive with a constant steer, at a speed that is held."""
    x = REST._replace(speed_m_s=speed)
    for _ in range(round(seconds / 2e-3)):
        x = car_step(p, x, CarInput(steer, 0.0, 0.0, 0.0, 1.0, 0.0), 2e-3)
        x = x._replace(speed_m_s=speed, longitudinal_m_s2=0.0)
    return x


@pytest.mark.parametrize("name", CARS)
@pytest.mark.parametrize("share", [0.02, 0.6])
def test_a_steady_turn_is_that_in_closed_form(name: str, share: float) -> None:
    """By the inverse of Fiala's curve, z = 3 (1 - (1 - F/D)^(1/3)); small turns are linear."""
    settings, car = free_of_drag(name)
    p, speed = car_params(settings.vehicle, car), settings.vehicle.speed_m_s
    curvature = share * p.friction * 9.80665 / speed**2
    turn = steady_turn(settings.vehicle, car, speed, curvature)
    slips = [
        3.0 * p.friction / tyre.stiffness_1_rad * (1.0 - math.cbrt(1.0 - share))
        for tyre in (p.front, p.rear)
    ]
    wheelbase = p.front_axle_m + p.rear_axle_m
    assert turn.steer_rad == pytest.approx(wheelbase * curvature + slips[0] - slips[1], rel=1e-9)
    if share < 0.1:
        linear = settings.vehicle.model_copy(update={"speed_m_s": speed})
        assert turn.steer_rad == pytest.approx(steady_steer_m(linear) * curvature, rel=0.01)
    driven = turned(p, speed, turn.steer_rad)
    assert driven.yaw_rate_rad_s == pytest.approx(
        speed * curvature, rel=0.03 if share > 0.1 else 3e-3
    )


@pytest.mark.parametrize("share_of_critical", [0.98, 1.02])
def test_an_oversteering_car_spins_from_its_critical_speed_on(share_of_critical: float) -> None:
    vehicle = VehicleSettings(
        front_cornering_stiffness_n_rad=200_000.0, rear_cornering_stiffness_n_rad=100_000.0
    )
    p = car_params(vehicle, CarSettings(drag_n_s2_m2=0.0, rolling_resistance=0.0))
    lf, lr = p.front_axle_m, p.rear_axle_m
    gradient = p.mass_kg / (lf + lr) * (lr / 200_000.0 - lf / 100_000.0)
    critical = math.sqrt(-(lf + lr) / gradient)
    x = REST._replace(speed_m_s=share_of_critical * critical, yaw_rate_rad_s=1e-6)
    rates = []
    for _ in range(10_000):
        x = car_step(p, x, CarInput(0.0, 0.0, 0.0, 0.0, 1.0, 0.0), 2e-3)
        rates.append(abs(x.yaw_rate_rad_s))
    assert (rates[-1] > rates[5000]) == (share_of_critical > 1.0)


def stored_j(tyre: TyreParams, load_n: float, limit_n: float, slip: float) -> float:
    """Energy in the deflection of an axle's tyres: σ ∫F dα′."""
    stiffness = tyre.stiffness_1_rad * load_n
    z = min(abs(stiffness * slip / limit_n), 3.0)
    return limit_n**2 / stiffness / tyre.relaxation_1_m * (z**2 / 2.0 - z**3 / 9.0 + z**4 / 108.0)


@pytest.mark.parametrize("h_s", [1e-3, 2.5e-4])
@given(
    st.sampled_from(CARS),
    st.floats(0.0, 1.0),
    st.floats(-1.0, 1.0),
    st.floats(-1.0, 1.0),
    st.floats(-0.5, 0.5),
    st.floats(0.1, 1.0),
)
def test_tyres_and_friction_never_create_energy(
    h_s: float, name: str, speed: float, side: float, yaw: float, wheel: float, friction: float
) -> None:
    """A car that coasts, whatever its slide: motion and deflection together only lose energy.

    But for the error of a step, whose bound shrinks with it: of 1,200 drawn, at most 2.7 of it.
    """
    settings, car = free_of_drag(name, cg_height_m=0.0)
    p = car_params(settings.vehicle, car)
    top = settings.vehicle.speed_m_s
    x = REST._replace(
        speed_m_s=speed * top,
        lateral_speed_m_s=0.3 * side * top,
        yaw_rate_rad_s=0.3 * yaw * top / (p.front_axle_m + p.rear_axle_m),
    )

    def energy_j(x: CarState) -> float:
        moving = p.mass_kg * (x.speed_m_s**2 + x.lateral_speed_m_s**2)
        turning = settings.vehicle.yaw_inertia_kg_m2 * x.yaw_rate_rad_s**2
        stored = [
            stored_j(tyre, load, p.friction * friction * load, slip)
            for tyre, load, slip in (
                (p.front, p.front_load_n, x.front_slip),
                (p.rear, p.rear_load_n, x.rear_slip),
            )
        ]
        return 0.5 * (moving + turning) + sum(stored)

    first = least = energy_j(x)
    for _ in range(round(0.4 / h_s)):
        x = car_step(p, x, CarInput(wheel, 0.0, 0.0, 0.0, friction, 0.0), h_s)
        least = min(least, energy_j(x))
        assert energy_j(x) <= least + 4.0 * h_s * first


@pytest.mark.parametrize("shape", [0.0, 1.5])
def test_a_tyre_starts_with_its_stiffness_and_never_exceeds_its_limit(shape: float) -> None:
    tyre = TyreParams(20.0, 2.5, 0.0, shape, -0.5)
    forces = [lateral_n(tyre, 5000.0, 4000.0, slip) for slip in np.linspace(0.0, 3.0, 2000)]
    assert forces[1] / (3.0 / 1999) == pytest.approx(20.0 * 5000.0, rel=0.02)
    assert 0.99 * 4000.0 <= max(forces) <= 4000.0
    assert lateral_n(tyre, 5000.0, 4000.0, -0.07) == -lateral_n(tyre, 5000.0, 4000.0, 0.07)


@pytest.mark.parametrize(
    ("ours", "exact", "error"),
    [
        (lambda x: cos_sin(x)[0], math.cos, 5e-16),
        (lambda x: cos_sin(x)[1], math.sin, 5e-16),
        (arctan, math.atan, 1.6e-9),
    ],
)
def test_portable_functions_have_their_stated_error(
    ours: Callable[[float], float], exact: Callable[[float], float], error: float
) -> None:
    points = np.concatenate([np.linspace(-7.0, 7.0, 20_001), np.geomspace(1e-9, 1e9, 2001)])
    points = points if ours is arctan else points[:20_001]
    assert max(abs(ours(float(x)) - exact(float(x))) for x in points) <= error


def test_a_turn_takes_a_share_of_the_grip_or_is_refused() -> None:
    # 1.379 m/s² of 1.173 times 9.81.
    settings = plant_preset("large_sedan")
    assert settings.car is not None
    speed_m_s = settings.vehicle.speed_m_s
    turn = steady_turn(settings.vehicle, settings.car, speed_m_s, 1.379 / speed_m_s**2)
    assert turn.grip_share == pytest.approx(0.12, abs=0.005)
    with pytest.raises(ValueError, match="drive more slowly, on a gentler bend or on more fric"):
        steady_turn(settings.vehicle, settings.car, speed_m_s, 1 / 20)
