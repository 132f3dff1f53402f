"""Sweeps of the multi-body cars of commonroad-vehicle-models, identified.

    pip install commonroad-vehicle-models
    python -m tests.searches.foreign_plant

Each car drives a sweep at 60 km/h alone, and with the one at 25 km/h that the program asks for: a
relaxation length is a lag that grows as the car slows down, which a single speed does not show.

The package's ``mb`` model has 29 states: roll, pitch, four wheels with the Magic Formula, and a
suspension with roll steer. The steering's lag is put before it. Mass, yaw inertia and geometry are
told.

Understeer changes with lateral acceleration, so both cars, the package's and the identified one,
are measured alike: in steady bends of the same lateral acceleration. Cars 2 and 3 are nearly
neutral: a hundredth of their steering gradient would be all of their understeer.
"""

import importlib
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.signal import lfilter

from steer_by_wire.closed_loop.identification.columns import joined
from steer_by_wire.closed_loop.identification.identified import Identification, identify
from steer_by_wire.closed_loop.identification.parameters import Known
from steer_by_wire.closed_loop.identification.response import Grid, respond
from steer_by_wire.closed_loop.identification.time_series import Channel, Quantity, make_drive
from steer_by_wire.closed_loop.identification.vehicle_file import figure_line
from steer_by_wire.runtime.array_types import FloatArray

STEP_S, LAG_S = 1e-3, 0.05
SWEEPS = ((16.7, 3.0), (7.0, 2.0))
"""Speed [m/s] and lateral acceleration [m/s²]."""
SIDES_M_S2 = (0.3, 1.0, 2.0, 3.0)
"""Of the steady bends: from next to none to that of the first sweep."""
Driven = Callable[[FloatArray, float], tuple[FloatArray, FloatArray]]
"""Takes wheel angles [rad] in steps of STEP_S and a speed; returns yaw rate and speed."""


def driven(
    parameters: Any, wheel_rad: FloatArray, speed_m_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return yaw rate and speed, by the midpoint rule."""
    dynamics = importlib.import_module("vehiclemodels.vehicle_dynamics_mb").vehicle_dynamics_mb
    begin = importlib.import_module("vehiclemodels.init_mb").init_mb
    x = np.array(begin([0.0, 0.0, wheel_rad[0], speed_m_s, 0.0, 0.0, 0.0], parameters))
    rate_rad_s, yaw_rate, speed = np.gradient(wheel_rad, STEP_S), [], []
    for wheel, turning in zip(wheel_rad, rate_rad_s, strict=True):
        x[2] = wheel
        yaw_rate.append(x[5])
        speed.append(x[3])
        demand = turning, 2.0 * (speed_m_s - x[3])
        halfway = x + 0.5 * STEP_S * np.array(dynamics(x, demand, parameters))
        x = x + STEP_S * np.array(dynamics(halfway, demand, parameters))
    return np.array(yaw_rate), np.array(speed)


def identified_car(found: Identification) -> Driven:
    """Return how an identified car is driven by its front wheels, which follow at once."""
    known = found.fit.problem.known
    zero = "delay_and_lag_s", "lag_squared_s2", "steering_offset_rad", "yaw_rate_offset_rad_s"
    values = found.fit.values | dict.fromkeys(zero, 0.0) | {"steering_ratio": 1.0}

    def drive(wheel_rad: FloatArray, speed_m_s: float) -> tuple[FloatArray, FloatArray]:
        time_s, still = STEP_S * np.arange(len(wheel_rad)), np.zeros_like(wheel_rad)
        speed, ends = np.full_like(wheel_rad, speed_m_s), np.array([0, len(wheel_rad)])
        every = (Channel("each step", Quantity.YAW_RATE, time_s, still),)
        driven = Grid(every, STEP_S, ends, still[:1], time_s, wheel_rad, speed, still, still[:0])
        return respond(driven, [values], known)[0][0], speed

    return drive


def understeer_rad_s2_m(drive: Driven, wheelbase_m: float, side_m_s2: float) -> float:
    """Return δ/a_y - L/u² of steady bends at the first sweep's speed.

    It is the mean of left and right: the tyres of this package pull to one side by 6 to 18 µrad,
    which one bend alone would take for a gradient of 0.01 mrad s²/m.
    """
    speed_m_s, rows = SWEEPS[0][0], []
    for side in (-side_m_s2, side_m_s2):
        wheel_rad = side * wheelbase_m / speed_m_s**2
        ramp = np.clip(np.arange(0.0, 4.0, STEP_S) / 0.3, 0.0, 1.0)
        yaw_rate, speed = (one[-200:].mean() for one in drive(wheel_rad * ramp, speed_m_s))
        rows.append((wheel_rad - wheelbase_m * yaw_rate / speed) / (speed * yaw_rate))
    return float(np.mean(rows))


def sweep(parameters: Any, number: int, which: int) -> list[Channel]:
    """Return the channels of a sweep from 0.2 to 3 Hz."""
    speed_m_s, side_m_s2 = SWEEPS[which]
    time_s = np.arange(0.0, 32.0, STEP_S)
    sweep_s = np.clip(time_s - 2.0, 0.0, 26.0)
    cycles = 0.2 * 26.0 / np.log(15.0) * (15.0 ** (sweep_s / 26.0) - 1.0)
    kept = np.exp(-STEP_S / LAG_S)
    wheelbase_m = parameters.a + parameters.b
    asked = side_m_s2 * wheelbase_m / speed_m_s**2 * np.sin(2.0 * np.pi * cycles)
    wheel = lfilter([1.0 - kept], [1.0, -kept], asked)
    yaw_rate, speed = driven(parameters, wheel, speed_m_s)
    rng = np.random.default_rng(number + 10 * which)
    noise = 1e-3 * rng.standard_normal(len(time_s[::10]))
    values = {
        Quantity.WHEEL: asked[::10],
        Quantity.SPEED: speed[::10],
        Quantity.YAW_RATE: yaw_rate[::10] + noise,
    }
    return [Channel(str(name), name, time_s[::10], it) for name, it in values.items()]


def main() -> None:
    """Print what is true and what is found of three cars."""
    for number in (1, 2, 3):
        module = importlib.import_module(f"vehiclemodels.parameters_vehicle{number}")
        parameters = getattr(module, f"parameters_vehicle{number}")()
        wheelbase_m = parameters.a + parameters.b
        known = Known(
            mass_kg=parameters.m, yaw_inertia_kg_m2=parameters.I_z, wheelbase_m=wheelbase_m,
            front_axle_distance_m=parameters.a,
        )  # fmt: skip
        car = partial(driven, parameters)
        true = [understeer_rad_s2_m(car, wheelbase_m, side) for side in SIDES_M_S2]
        steering_rad_s2_m = wheelbase_m / SWEEPS[0][0] ** 2 + true[0]
        sweeps = [sweep(parameters, number, which) for which in range(len(SWEEPS))]
        for count in (1, 2):
            found = identify(make_drive(joined(sweeps[:count]), f"car {number}"), known)
            lines = [f"car {number}, {count} sweeps: residual {found.fit.residual_percent:.2f} %"]
            told = ("understeer_gradient_rad_s2_m", "delay_and_lag_s")
            lines += [figure_line(one) for one in found.figures if one.name in told]
            lines += [note for note in found.notes if note.startswith("nearly neutral")]
            drive_found = identified_car(found)
            for side, its in zip(SIDES_M_S2, true, strict=True):
                mine = understeer_rad_s2_m(drive_found, wheelbase_m, side)
                lines.append(
                    f"at {side:g} m/s2 {1e3 * mine:.3f} of {1e3 * its:.3f} mrad s2/m:"
                    f" {100.0 * (mine / its - 1.0):+.1f} %,"
                    f" {100.0 * (mine - its) / steering_rad_s2_m:+.2f} % of the steering gradient"
                )
            sys.stdout.write("\n  ".join(lines) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
