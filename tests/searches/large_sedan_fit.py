"""A fit of the large sedan to a log by least squares; the preset ``large_sedan`` has its result.

    python -m tests.searches.large_sedan_fit LOG.csv             fit, and its residual
    python -m tests.searches.large_sedan_fit --predict LOG.csv   the preset's residual on a log

The log has columns ``time_s``, ``hand_wheel_rad``, ``speed_m_s`` and ``yaw_rate_rad_s`` in equal
steps. The residual is 100 rms(measured - simulated)/std(measured) of the yaw rate without the first
second, open loop from hand wheel and speed. A constant offset of the wheel is always fitted.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from steer_by_wire.closed_loop.compiled.step_functions import register_steps
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.plant_emulator.vehicle.car.car_design import car_params
from steer_by_wire.plant_emulator.vehicle.car.car_step import CarInput, CarState, car_step

STEERING_RATIO = 16.3
FITTED = (
    "vehicle.front_cornering_stiffness_n_rad",
    "vehicle.rear_cornering_stiffness_n_rad",
    "car.friction",
    "car.front_relaxation_m",
    "actuator.lag_s",
)
"""Both axles have the same relaxation length."""
OFFSET_RAD_MAX = 0.05
STEPS = 10
"""Per row of the log."""


class Log:
    """A log, with the acceleration that moves load between the axles."""

    def __init__(self, file: Path) -> None:
        rows = np.genfromtxt(
            file, delimiter=",", names=True, comments=None, skip_header=_head(file)
        )
        self.step_s = float(np.median(np.diff(rows["time_s"])))
        self.steer_rad = rows["hand_wheel_rad"] / STEERING_RATIO
        self.speed_m_s, self.yaw_rate_rad_s = rows["speed_m_s"], rows["yaw_rate_rad_s"]
        half = round(0.25 / self.step_s)
        padded = np.pad(self.speed_m_s, half, mode="edge")
        smooth = np.convolve(padded, np.ones(2 * half + 1) / (2 * half + 1), "valid")
        self.acceleration_m_s2 = np.gradient(smooth, self.step_s)
        self.judged = slice(round(1.0 / self.step_s), None)

    def errors(self, settings: PlantSettings, offset_rad: float) -> NDArray[np.float64]:
        """Return the errors of the yaw rate in percent of its standard deviation."""
        assert settings.car is not None
        without = settings.car.model_copy(update={"drag_n_s2_m2": 0.0, "rolling_resistance": 0.0})
        simulated = _yaw_rates_rad_s(
            car_params(settings.vehicle, without),
            (float(self.yaw_rate_rad_s[0]), settings.actuator.lag_s, self.step_s / STEPS),
            self.steer_rad + offset_rad,
            self.speed_m_s,
            self.acceleration_m_s2,
        )
        measured = self.yaw_rate_rad_s[self.judged]
        return 100.0 * (measured - simulated[self.judged]) / measured.std()


def _head(file: Path) -> int:
    with file.open() as lines:
        return next(count for count, line in enumerate(lines) if not line.startswith("#"))


@numba.njit
def _yaw_rates_rad_s(
    p: Any, start: Any, steer_rad: Any, speed_m_s: Any, acceleration_m_s2: Any
) -> Any:
    yaw_rate_rad_s, lag_s, h_s = start
    x = CarState(speed_m_s[0], 0.0, yaw_rate_rad_s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    wheel_rad, yaw_rates = steer_rad[0], np.empty(len(steer_rad))
    for row in range(len(steer_rad) - 1):
        yaw_rates[row] = x.yaw_rate_rad_s
        for step in range(1, STEPS + 1):
            share = step / STEPS
            goal_rad = steer_rad[row] + share * (steer_rad[row + 1] - steer_rad[row])
            wheel_rad += min(h_s / (lag_s + 0.5 * h_s), 1.0) * (goal_rad - wheel_rad)
            inputs = CarInput(wheel_rad, acceleration_m_s2[row], 0.0, 0.0, 1.0, 0.0)
            _, v, r, front, rear, a_x, a_y, force, use, _, _, _ = car_step(p, x, inputs, h_s)
            driven = speed_m_s[row] + share * (speed_m_s[row + 1] - speed_m_s[row])
            x = CarState(driven, v, r, front, rear, a_x, a_y, force, use, 0.0, 0.0, 0.0)
    yaw_rates[-1] = x.yaw_rate_rad_s
    return yaw_rates


def _with(settings: PlantSettings, values: Any) -> PlantSettings:
    """Return the settings with other values of ``FITTED``."""
    content = settings.model_dump()
    for key, value in zip(FITTED, values, strict=True):
        table, name = key.split(".")
        content[table][name] = float(value)
    content["car"]["rear_relaxation_m"] = content["car"]["front_relaxation_m"]
    return PlantSettings.model_validate(content)


def main(arguments: list[str]) -> None:
    """Fit, or predict."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--predict", action="store_true")
    parser.add_argument("log", type=Path)
    options = parser.parse_args(arguments)
    register_steps()
    log, start = Log(options.log), plant_preset("large_sedan")
    scale = np.array([getattr(getattr(start, t), k) for t, k in (key.split(".") for key in FITTED)])
    free = 0 if options.predict else len(FITTED)

    def errors(x: Any) -> NDArray[np.float64]:
        values = scale * np.append(x[:free], np.ones(len(FITTED) - free))
        return log.errors(_with(start, values), x[-1])

    # From far beside the result of an earlier fit.
    guess = np.array([*[0.7] * free, 0.0])
    bounds = [*[0.2] * free, -OFFSET_RAD_MAX], [*[4.0] * free, OFFSET_RAD_MAX]
    scales = [*[1.0] * free, 0.01]
    found = least_squares(errors, guess, bounds=bounds, x_scale=scales, diff_step=1e-4)
    fitted = zip(FITTED[:free], scale[:free] * found.x[:free], strict=True)
    lines = [f"{key} = {value:.6g}" for key, value in fitted]
    residual = f"residual of yaw rate: {np.sqrt(np.mean(found.fun**2)):.2f} %"
    lines += [f"steering offset {found.x[-1]:.4f} rad", residual, ""]
    sys.stdout.write("\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])
