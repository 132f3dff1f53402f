"""Programs of steering over time, and the drive of a car that follows one on a straight road.

A program gives the command to the steering's actuator, every millisecond. Road, speed control,
tyres and steering are those of the plant; no disturbance acts.
"""

from collections.abc import Callable
from math import pi, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....plant_emulator.path.settings import StraightSettings
from ....plant_emulator.settings import PlantSettings, plant_motion_params
from ....plant_emulator.vehicle.car.car_motion import STEP_NS, advance_car, command_car, start_car
from ....plant_emulator.vehicle.car.settings import CarSettings
from ....plant_emulator.vehicle.settings import DisturbanceSettings
from ....runtime.node import NS_PER_S
from ....runtime.settings import SettingsError

BEGINS_S = 0.5
"""Straight on before every program."""
DWELL_HZ, DWELL_S = 0.7, 0.5
"""FMVSS 126, S7.9: a sine that rests at its second peak."""
DWELL_ENDS_S = 1.0 / DWELL_HZ + DWELL_S

Program = Callable[[float], float]
"""The command [rad] at a time [s] after the program begins."""


class Drive(NamedTuple):
    """A drive, sampled every millisecond; arrays of one length.

    ``time_s``       since the program began
    ``wheel_rad``    as the steering's sensor reads it
    ``aside_m``      of the centre of gravity, from its straight path to the left
    """

    time_s: NDArray[np.float64]
    command_rad: NDArray[np.float64]
    wheel_rad: NDArray[np.float64]
    speed_m_s: NDArray[np.float64]
    side_slip_rad: NDArray[np.float64]
    yaw_rate_rad_s: NDArray[np.float64]
    lateral_m_s2: NDArray[np.float64]
    aside_m: NDArray[np.float64]


def car_of(plant: PlantSettings) -> CarSettings:
    """Return the car of a plant; raises SettingsError for a linear vehicle."""
    if plant.car is None:
        raise SettingsError(
            "vehicle_tests.plants: a linear vehicle; it has to be a car, as bmw_320i"
        )
    return plant.car


def drive(plant: PlantSettings, speed_m_s: float, program: Program, duration_s: float) -> Drive:
    """Return the drive of a car that begins at a speed; raises SettingsError without `[car]`."""
    vehicle = plant.vehicle.model_copy(
        update={
            "speed_m_s": speed_m_s,
            "initial_lateral_error_m": 0.0,
            "initial_heading_error_rad": 0.0,
        }
    )
    on_straight = {
        "vehicle": vehicle,
        "car": car_of(plant).model_copy(update={"speed": ()}),
        "path": StraightSettings(),
        "disturbance": DisturbanceSettings(),
        "faults": (),
    }
    params: Any = plant_motion_params(plant.model_copy(update=on_straight))
    state = start_car(params)
    rows = []
    dead_steps = -(-params.dead_time_ns // STEP_NS)
    for step in range(round((BEGINS_S + duration_s) * NS_PER_S / STEP_NS)):
        at_s = step * STEP_NS / NS_PER_S - BEGINS_S
        acting_s = at_s - dead_steps * STEP_NS / NS_PER_S
        command_rad = program(at_s) if at_s >= 0.0 else 0.0
        state = command_car(params, state, program(acting_s) if acting_s >= 0.0 else 0.0)
        _, shown, (_, _, now, *_) = state
        side_slip_rad, yaw_rate_rad_s, _, _, wheel_rad, *_ = shown
        car = now.car
        aside_m = car.lateral_error_m - params.preview_distance_m * sin(car.heading_error_rad)
        rows.append(
            (
                at_s,
                command_rad,
                wheel_rad,
                car.speed_m_s,
                side_slip_rad,
                yaw_rate_rad_s,
                car.lateral_m_s2,
                aside_m,
            )
        )
        state = advance_car(params, state, (step + 1) * STEP_NS)
    return Drive(*np.array(rows).T)


def held(steer_rad: float) -> Program:
    """Return a step."""
    return lambda _: steer_rad


def ramp(rate_rad_s: float) -> Program:
    """Return a steer that grows slowly."""
    return lambda at_s: rate_rad_s * at_s


def one_sine(steer_rad: float, frequency_hz: float) -> Program:
    """Return one period of a sine."""
    return lambda at_s: steer_rad * sin(2.0 * pi * frequency_hz * at_s) * (at_s < 1 / frequency_hz)


def sine_with_dwell(steer_rad: float) -> Program:
    """Return a sine of 0.7 Hz that rests half a second at its second peak."""
    peak_s = 0.75 / DWELL_HZ

    def program(at_s: float) -> float:
        along_s = min(at_s, max(peak_s, at_s - DWELL_S))
        return steer_rad * sin(2.0 * pi * DWELL_HZ * along_s) * (at_s < DWELL_ENDS_S)

    return program
