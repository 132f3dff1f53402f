"""Drives of drawn cars: steering and speed over time, what the car does, what its sensors show.

The lag and the dead time of the steering are computed here, from steering that is known at any
time; the motion is that of ``car_step``. The sensors' offsets, noise and steps are drawn.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from steer_by_wire.closed_loop.identification.parameters import Known
from steer_by_wire.closed_loop.identification.response import STEP_S, Grid, respond
from steer_by_wire.closed_loop.identification.time_series import Channel, Quantity
from steer_by_wire.runtime.array_types import FloatArray

PERIOD_S = 0.01
_STEP_RAD = 0.0017
"""Of the hand wheel's sensor."""


class DrawnDrive(NamedTuple):
    """Channels as a log has them, what is true of the car, and what may be told to the program."""

    channels: list[Channel]
    truth: Mapping[str, float]
    known: Known


def drawn_car(rng: np.random.Generator) -> dict[str, float]:
    """Return the parameters of a car, by the names of ``parameters``."""
    lag_s = float(rng.uniform(0.01, 0.12))
    front_c = float(rng.uniform(9.0, 22.0))
    return {
        "wheelbase_m": float(2.75 * np.exp(0.08 * rng.standard_normal())),
        "front_share": float(np.clip(0.45 + 0.05 * rng.standard_normal(), 0.33, 0.6)),
        "front_c": front_c,
        "rear_c": front_c * float(rng.uniform(1.0, 1.7)),
        "inertia": float(rng.uniform(0.75, 1.15)),
        "friction": float(rng.uniform(0.7, 1.1)),
        "relaxation_m": float(rng.uniform(0.2, 0.7)),
        "lag_squared_s2": lag_s**2,
        "delay_and_lag_s": lag_s + float(rng.uniform(0.0, 0.08)),
        "steering_ratio": float(rng.uniform(12.0, 19.0)),
        "steering_offset_rad": float(0.03 * rng.standard_normal()),
        "yaw_rate_offset_rad_s": float(0.005 * rng.standard_normal()),
        "lateral_acceleration_m_s2:offset": float(0.15 * rng.standard_normal()),
        "lateral_acceleration_m_s2:gain": float(1.0 + 0.03 * rng.standard_normal()),
        "drive_front": float(rng.integers(2)),
    }


def gain_1_s(car: Mapping[str, float], speed_m_s: FloatArray) -> FloatArray:
    """Return yaw rate over hand wheel angle in a steady turn."""
    gradient = (1.0 / car["front_c"] - 1.0 / car["rear_c"]) / 9.80665
    return speed_m_s / (car["wheelbase_m"] + gradient * speed_m_s**2) / car["steering_ratio"]


def prescribed(car: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Return steering [rad] and speed [m/s] on the grid: sweep at 60, steps at 80, hard slalom."""
    time_s = np.arange(0.0, 70.0, STEP_S)
    speed = np.interp(time_s, [0, 3, 32, 40, 70], [11.0, 16.7, 16.7, 22.2, 22.2])
    sweep_s = np.clip(time_s - 4.0, 0.0, 26.0)
    phase = 2.0 * np.pi * 0.2 * 26.0 / np.log(15.0) * (15.0 ** (sweep_s / 26.0) - 1.0)
    # No driver turns a wheel at once, and no sensor of 100 Hz would show when.
    a_y = 4.0 * np.sin(phase) * np.clip((30.0 - time_s) / 0.2, 0.0, 1.0)
    for start_s, end_s, level in ((41, 44, 3.0), (46, 49, -3.5), (51, 53, 2.0)):
        ramp = np.clip((time_s - start_s) / 0.2, 0, 1) - np.clip((time_s - end_s) / 0.2, 0, 1)
        a_y = a_y + level * ramp
    slalom_s = np.clip(time_s - 55.0, 0.0, 14.0)
    a_y = a_y + 9.0 * car["friction"] * slalom_s / 14.0 * np.sin(2.0 * np.pi * 0.45 * slalom_s)
    return a_y / speed / gain_1_s(car, speed), speed


def normal(car: Mapping[str, float], rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return steering and speed of 120 s of ordinary driving."""
    time_s = np.arange(0.0, 120.0, STEP_S)
    knots = rng.uniform(11.0, 25.0, 13)
    speed = np.interp(time_s, np.arange(0.0, 121.0, 10.0), knots)
    kept = np.exp(-STEP_S / 0.8)
    low = [1.0 - kept], [1.0, -kept]
    slow = lfilter(*low, lfilter(*low, rng.standard_normal(len(time_s))))
    a_y = 1.2 * slow / slow.std()
    return a_y / speed / gain_1_s(car, speed), speed


def log_of(
    car: Mapping[str, float],
    steering_rad: FloatArray,
    speed_m_s: FloatArray,
    rng: np.random.Generator,
    *,
    delays_s: Mapping[str, float] | None = None,
    knows: bool = True,
    network: tuple[float, float] = (0.0, 0.0),
) -> DrawnDrive:
    """Return what a log has of a drive.

    ``delays_s``  by which further channels come late
    ``knows``     whether mass, geometry and ratio are told
    ``network``   jitter of its latency [s] and share of samples lost, in bursts of three
    """
    lag_s = float(np.sqrt(car["lag_squared_s2"]))
    steps, dead_s = np.arange(len(steering_rad)), car["delay_and_lag_s"] - lag_s
    late = np.interp(steps - dead_s / STEP_S, steps, steering_rad)
    kept = np.exp(-STEP_S / lag_s)
    # Exact for steering that is straight between two steps.
    new = 1.0 - lag_s / STEP_S * (1.0 - kept)
    wheel, _ = lfilter([new, 1.0 - kept - new], [1.0, -kept], late, zi=[late[0] * (1.0 - new)])
    still = {**car, "lag_squared_s2": 0.0, "delay_and_lag_s": 0.0}
    ends, driven = np.array([0, len(steps)]), (speed_m_s, np.gradient(speed_m_s, STEP_S))
    time_s = steps * STEP_S
    at_ends = np.append(wheel[1:], wheel[-1:])
    side = Quantity.LATERAL_ACCELERATION
    every = tuple(Channel(one, one, time_s, time_s) for one in (Quantity.YAW_RATE, side))
    grid = Grid(every, STEP_S, ends, np.zeros(1), time_s, at_ends, *driven, np.empty(0))
    ((yaw_rate, side_m_s2),) = respond(grid, [still], Known())
    # The sensor's steps lie anywhere: straight on is within one, and not in its middle.
    zero_rad = float(rng.uniform(-0.5, 0.5)) * _STEP_RAD
    at_s, channels = np.arange(0.0, time_s[-1], PERIOD_S), list[Channel]()
    for quantity, values, noise, quantum in (
        (Quantity.HAND_WHEEL, steering_rad + zero_rad, 0.0, _STEP_RAD),
        (Quantity.SPEED, speed_m_s, 0.0, 0.01),
        (Quantity.YAW_RATE, yaw_rate, rng.uniform(0.001, 0.004), 5e-4),
        (side, side_m_s2, rng.uniform(0.03, 0.12), 0.01),
    ):
        seen = np.interp(at_s - (delays_s or {}).get(quantity, 0.0), time_s, values)
        noisy = np.round((seen + noise * rng.standard_normal(len(at_s))) / quantum) * quantum
        channels.append(_received(Channel(str(quantity), quantity, at_s, noisy), rng, *network))
    told = {
        "mass_kg": 1800.0,
        "wheelbase_m": car["wheelbase_m"],
        "front_axle_distance_m": car["front_share"] * car["wheelbase_m"],
        "steering_ratio": car["steering_ratio"],
    }
    truth = {f"{name}:delay_s": value for name, value in (delays_s or {}).items()} | car
    truth["steering_offset_rad"] -= zero_rad
    return DrawnDrive(channels, truth, Known(**told) if knows else Known())


def _received(channel: Channel, rng: np.random.Generator, jitter_s: float, loss: float) -> Channel:
    """Return the samples that arrive, in order, at the times of their arrival."""
    if not jitter_s:
        return channel
    late_s = rng.gamma(2.0, jitter_s / np.sqrt(2.0), len(channel.time_s)) - np.sqrt(2.0) * jitter_s
    at_s = np.maximum.accumulate(channel.time_s + late_s + 1e-7 * np.arange(len(late_s)))
    burst = rng.uniform(size=len(late_s)) < loss / 3.0
    kept = ~(burst | np.roll(burst, 1) | np.roll(burst, 2))
    return channel._replace(time_s=at_s[kept], values=channel.values[kept])
