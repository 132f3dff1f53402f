"""Sweeps of the multi-body cars of commonroad-vehicle-models, identified.

    pip install commonroad-vehicle-models
    python -m tests.searches.foreign_plant

Each car drives a sweep at 60 km/h alone, and with the one at 25 km/h that the program asks for: a
relaxation length is a lag that grows as the car slows down, which a single speed does not show.

The package's ``mb`` model has 29 states: roll, pitch, four wheels with the Magic Formula, and a
suspension with roll steer. What is true of its understeer is measured on it, in steady bends: it
changes by 6 to 21 % up to the sweep's lateral acceleration. The steering's lag is put before it.
Mass, yaw inertia and geometry are told.
"""

import importlib
import sys
from typing import Any

import numpy as np
from scipy.signal import lfilter

from steer_by_wire.closed_loop.identification.columns import joined
from steer_by_wire.closed_loop.identification.identified import identify
from steer_by_wire.closed_loop.identification.parameters import Known
from steer_by_wire.closed_loop.identification.time_series import Channel, Quantity, make_drive
from steer_by_wire.runtime.array_types import FloatArray

STEP_S, LAG_S = 1e-3, 0.05
SWEEPS = ((16.7, 3.0), (7.0, 2.0))
"""Speed [m/s] and lateral acceleration [m/s²]."""
SIDES_M_S2 = (0.3, 3.0)
"""Of the steady bends: next to none, and as in the first sweep."""


def driven(parameters: Any, wheel_rad: FloatArray, speed_m_s: float) -> tuple[FloatArray, ...]:
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


def understeer_rad_s2_m(parameters: Any, side_m_s2: float) -> float:
    """Return δ/a_y - L/u² of steady bends at the first sweep's speed.

    It is the mean of left and right: the tyres of this package pull to one side by 6 to 18 µrad,
    which one bend alone would take for a gradient of 0.01 mrad s²/m.
    """
    wheelbase_m, speed_m_s, rows = parameters.a + parameters.b, SWEEPS[0][0], []
    for side in (-side_m_s2, side_m_s2):
        wheel_rad = side * wheelbase_m / speed_m_s**2
        ramp = np.clip(np.arange(0.0, 4.0, STEP_S) / 0.3, 0.0, 1.0)
        yaw_rate, speed = (
            one[-200:].mean() for one in driven(parameters, wheel_rad * ramp, speed_m_s)
        )
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
        known = Known(
            mass_kg=parameters.m, yaw_inertia_kg_m2=parameters.I_z,
            wheelbase_m=parameters.a + parameters.b, front_axle_distance_m=parameters.a,
        )  # fmt: skip
        true = " and ".join(
            f"{1e3 * understeer_rad_s2_m(parameters, side):.3f} at {side:g} m/s2"
            for side in SIDES_M_S2
        )
        sys.stdout.write(
            f"car {number}: understeer {true} [mrad s2/m], delay and lag {1e3 * LAG_S:.0f} ms\n"
        )
        sweeps = [sweep(parameters, number, which) for which in range(len(SWEEPS))]
        for count in (1, 2):
            drive = make_drive(joined(sweeps[:count]), f"car {number}")
            found = identify(drive, known, is_brief=True)
            named = {one.name: one for one in found.figures}
            gradient, total = named["understeer_gradient_rad_s2_m"], named["delay_and_lag_s"]
            sys.stdout.write(
                f"  {count} sweeps: understeer {1e3 * gradient.value:.3f}"
                f" [{1e3 * gradient.low:.3f}, {1e3 * gradient.high:.3f}]; delay and lag"
                f" {1e3 * total.value:.1f} [{1e3 * total.low:.1f}, {1e3 * total.high:.1f}],"
                f" {total.verdict}; residual {found.residual_percent:.2f} %\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
