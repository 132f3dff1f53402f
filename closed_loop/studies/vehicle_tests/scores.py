"""Figures of the standard tests of a car without a driver.

    ISO 4138:2021, constant speed, slowly increasing steer
        understeer gradient   d(δ − L ρ)/d a_y, fitted over a_y from 0.5 to 2 m/s²
        largest a_y, and whether the front or the rear axle ends the turn
    ISO 7401:2011, step to 4 m/s²; times count from half of the wheels' own step
        response time to 90 % of the steady value, peak time, overshoot, TB (peak time × side slip)
    ISO 7401:2011, one sine; lag from the second peak of the wheels to that of the response
    FMVSS 126 (49 CFR 571.126), sine with dwell at 80 km/h, from 1.5 A to 6.5 A in steps of 0.5 A
        yaw rate 1 s and 1.75 s after the steer ends, over its largest: at most 35 % and 20 %
        displacement 1.07 s after it begins, from 5 A on: at least 1.83 m
    A  is the steer of 0.3 g in a steady turn at that speed.

The steer δ is that of the front wheels. ISO 4138 and 7401 take the hand wheel's, and FMVSS 126 adds
270 degrees of the hand wheel to its range: a plant has no steering ratio.
"""

import math
from collections.abc import Callable
from math import pi, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....plant_emulator.path.drivability import GRAVITY_M_S2
from ....plant_emulator.path.settings import StraightSettings
from ....plant_emulator.settings import PlantSettings, plant_motion_params
from ....plant_emulator.vehicle.car.car_motion import STEP_NS, advance_car, command_car, start_car
from ....plant_emulator.vehicle.car.settings import CarSettings
from ....plant_emulator.vehicle.car.steady_state import steady_turn
from ....plant_emulator.vehicle.settings import DisturbanceSettings
from ....runtime.node import NS_PER_S
from ....runtime.settings import SettingsError
from .settings import VehicleTestSettings

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
    """Return the drive of a car that begins at a speed; raises SettingsError without `[car]`.

    The program gives the command to the steering's actuator, every millisecond. Road, speed
    control, tyres and steering are those of the plant; no disturbance acts.
    """
    start = {"initial_lateral_error_m": 0.0, "initial_heading_error_rad": 0.0}
    on_straight = {
        "vehicle": plant.vehicle.model_copy(update={"speed_m_s": speed_m_s, **start}),
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
        turning = side_slip_rad, yaw_rate_rad_s, car.lateral_m_s2
        rows.append((at_s, command_rad, wheel_rad, car.speed_m_s, *turning, aside_m))
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


DWELL_M_S = 80.0 / 3.6
DWELL_FACTORS = np.arange(1.5, 6.6, 0.5).tolist()
YAW_SHARE_MAX, LATER_YAW_SHARE_MAX, ASIDE_M_MIN = 0.35, 0.20, 1.83
_ASIDE_S, _FROM_FACTOR = 1.07, 5.0
_SLOWLY_M_S3 = 0.3
"""Growth of the lateral acceleration in the steady turn; chosen: a fifth as fast moves the gradient
of large_sedan by less than 0.1 %."""
_FITTED_M_S2 = 0.5, 2.0


class SteadyScore(NamedTuple):
    """ISO 4138; the gradient in rad/(m/s²), positive for an understeering car."""

    understeer_rad_s2_m: float
    lateral_m_s2_max: float
    slides_first: str


class StepScore(NamedTuple):
    """ISO 7401, step; times [s], overshoot over the steady value, TB [s rad]."""

    yaw_response_s: float
    yaw_peak_s: float
    yaw_overshoot: float
    lateral_response_s: float
    tb_s_rad: float
    steering_s: float
    """From the command to half of the wheels' step."""


class SineScore(NamedTuple):
    """ISO 7401, one sine: lag of the second peaks [s]."""

    yaw_lag_s: float
    lateral_lag_s: float


class DwellScore(NamedTuple):
    """FMVSS 126: the worst of all steers, and the first factor of A at which the car fails."""

    yaw_share: float
    later_yaw_share: float
    aside_m: float
    fails_from: float | None


class CarScores(NamedTuple):
    """All tests of a car, and the drives that the picture shows."""

    steady: SteadyScore
    step: StepScore
    sine: SineScore
    dwell: DwellScore
    turning: Drive
    stepping: Drive
    dwelling: Drive


def scores_of(plant: PlantSettings, settings: VehicleTestSettings) -> CarScores:
    """Return the scores of a car; raises SettingsError where its tyres cannot hold a test."""
    speed_m_s = settings.speed_km_h / 3.6
    steer_rad = _steer_rad(plant, speed_m_s, settings.lateral_m_s2)
    grip_m_s2 = GRAVITY_M_S2 * car_of(plant).friction
    slowly = ramp(_steer_rad(plant, speed_m_s, 1.0) * _SLOWLY_M_S3)
    turning = drive(plant, speed_m_s, slowly, 2.0 * grip_m_s2 / _SLOWLY_M_S3)
    stepping = drive(plant, speed_m_s, held(steer_rad), 4.0)
    period_s = 1.0 / settings.sine_hz
    waving = drive(plant, speed_m_s, one_sine(steer_rad, settings.sine_hz), 1.5 * period_s)
    dwell_rad = _steer_rad(plant, DWELL_M_S, 0.3 * GRAVITY_M_S2)
    dwelling = [
        drive(plant, DWELL_M_S, sine_with_dwell(factor * dwell_rad), DWELL_ENDS_S + 2.0)
        for factor in DWELL_FACTORS
    ]
    steady, step = steady_score(plant, turning), step_score(stepping)
    sine, dwell = sine_score(waving, period_s), dwell_score(dwelling)
    return CarScores(steady, step, sine, dwell, turning, stepping, dwelling[-1])


def _steer_rad(plant: PlantSettings, speed_m_s: float, lateral_m_s2: float) -> float:
    """Return the steer of a steady turn."""
    car = car_of(plant)
    try:
        turn = steady_turn(plant.vehicle, car, speed_m_s, lateral_m_s2 / speed_m_s**2)
    except ValueError as error:
        raise SettingsError(f"vehicle_tests.lateral_m_s2 = {lateral_m_s2:g}: {error}") from None
    return turn.steer_rad


def steady_score(plant: PlantSettings, run: Drive) -> SteadyScore:
    """Return the figures of a turn whose steer grows slowly."""
    wheelbase_m = plant.vehicle.front_axle_distance_m + plant.vehicle.rear_axle_distance_m
    peak = int(np.argmax(run.lateral_m_s2))
    low, high = _FITTED_M_S2
    fitted = (run.lateral_m_s2 >= low) & (run.lateral_m_s2 <= high)
    fitted[peak:] = False
    curvature_1_m = run.yaw_rate_rad_s[fitted] / run.speed_m_s[fitted]
    over_rad = run.wheel_rad[fitted] - wheelbase_m * curvature_1_m
    gradient = float(np.polyfit(run.lateral_m_s2[fitted], over_rad, 1)[0])
    # A car whose rear axle slides turns round; the other kind runs wide.
    slides = "rear" if abs(run.side_slip_rad[-1]) > math.radians(20.0) else "front"
    return SteadyScore(gradient, float(run.lateral_m_s2[peak]), slides)


def step_score(run: Drive) -> StepScore:
    """Return the figures of a step of the steer."""
    half_s = _reached_s(run, run.wheel_rad, 0.5)
    yaw_peak = int(np.argmax(np.abs(run.yaw_rate_rad_s)))
    peak_s = float(run.time_s[yaw_peak]) - half_s
    overshoot = float(run.yaw_rate_rad_s[yaw_peak] / run.yaw_rate_rad_s[-1]) - 1.0
    yaw_s, lateral_s = (
        _reached_s(run, values, 0.9) - half_s for values in (run.yaw_rate_rad_s, run.lateral_m_s2)
    )
    tb_s_rad = peak_s * abs(float(run.side_slip_rad[-1]))
    return StepScore(yaw_s, peak_s, overshoot, lateral_s, tb_s_rad, half_s)


def _reached_s(run: Drive, values: NDArray[np.float64], share: float) -> float:
    """Return when a share of the last value is reached first."""
    return float(run.time_s[np.argmax(values / values[-1] >= share)])


def sine_score(run: Drive, period_s: float) -> SineScore:
    """Return the lags of the second peaks, which are negative."""
    second = run.time_s > 0.5 * period_s

    def peak_s(values: NDArray[np.float64]) -> float:
        return float(run.time_s[second][np.argmin(values[second])])

    wheel_s = peak_s(run.wheel_rad)
    return SineScore(peak_s(run.yaw_rate_rad_s) - wheel_s, peak_s(run.lateral_m_s2) - wheel_s)


def dwell_score(runs: list[Drive]) -> DwellScore:
    """Return the worst figures of sines with dwell, one for each of ``DWELL_FACTORS``."""
    worst, aside_m, fails_from = (0.0, 0.0), math.inf, None
    for factor, run in zip(DWELL_FACTORS, runs, strict=True):
        # The second peak of the yaw rate is negative, as the steer then.
        peak_rad_s = float(np.min(run.yaw_rate_rad_s[run.time_s > 0.0]))
        after_s = DWELL_ENDS_S + 1.0, DWELL_ENDS_S + 1.75
        shares = [float(np.interp(at_s, run.time_s, run.yaw_rate_rad_s)) for at_s in after_s]
        first, later = (value / peak_rad_s for value in shares)
        worst = max(worst[0], first), max(worst[1], later)
        fails = first > YAW_SHARE_MAX or later > LATER_YAW_SHARE_MAX
        if factor >= _FROM_FACTOR:
            moved_m = abs(float(np.interp(_ASIDE_S, run.time_s, run.aside_m)))
            aside_m = min(aside_m, moved_m)
            fails = fails or moved_m < ASIDE_M_MIN
        if fails and fails_from is None:
            fails_from = factor
    return DwellScore(*worst, aside_m, fails_from)
