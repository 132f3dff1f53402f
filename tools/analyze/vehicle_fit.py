"""Whether a log's car turns as a vehicle model does: its yaw rate against the model's.

The smoother takes lateral error, heading error and wheel angle, not the yaw rate of VEHICLE_STATE,
which therefore tests it. The model's yaw rate for the wheel angles of the log, times a ratio, plus
a bias (an offset of the wheel or a side wind), is fitted to the measured one. The ratio is 1 for
the right vehicle, and less for one that is heavier or has softer front tyres.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from ...controller.filters.settings import VehicleModelSettings
from ...controller.prediction.gains_over_speed import EstimatorSettings, sampled_vehicles
from ...runtime.array_types import FloatArray

DEVIATIONS = 3.0
MARGIN = 0.03
"""Of the ratio: wheel angle and yaw rate come at times of their own."""
_KNOWN_STD_MAX = 0.1
_SPEED_SPREAD_MAX = 0.1
"""Of the mean speed; the model is one speed's."""
_BLOCKS = 10
_SMOOTHED_S = 0.3


class YawRateFit(NamedTuple):
    """Measured over modelled yaw rate, and its standard deviation."""

    yaw_rate_ratio: float
    yaw_rate_ratio_std: float

    def in_words(self) -> str:
        """Return the sentence for a screen."""
        ratio, std = self
        if not std < _KNOWN_STD_MAX:
            return "vehicle: the log does not show whether the model fits"
        times = f"{ratio:.2f} ± {std:.2f} times the model's"
        if abs(ratio - 1.0) <= MARGIN + DEVIATIONS * std:
            return f"vehicle: the model fits, yaw rate {times}"
        return f"vehicle: THE MODEL DOES NOT FIT, yaw rate {times}: take no state from smoothed.csv"


UNKNOWN = YawRateFit(float("nan"), float("inf"))


def yaw_rate_fit(
    vehicle: VehicleModelSettings,
    speeds_m_s: Sequence[float],
    period_s: float,
    wheel_rad: FloatArray,
    yaw_rate_rad_s: FloatArray,
) -> YawRateFit:
    """Return how the yaw rate compares with the model's at the mean speed.

    Its deviation is the jackknife's over blocks of the log, so that what the model leaves may be
    correlated. UNKNOWN where the wheel rests, or the speed changes too much for one model.

    ``wheel_rad``, ``yaw_rate_rad_s``  of samples a period apart, shape (samples,)
    """
    speed_m_s = float(np.mean(speeds_m_s))
    if np.ptp(speeds_m_s) > _SPEED_SPREAD_MAX * speed_m_s:
        return UNKNOWN
    model = sampled_vehicles(EstimatorSettings(), vehicle, [speed_m_s], period_s)
    f, g = model.f[0, :2, :2], model.g[0, :2]
    state, modelled = np.linalg.solve(np.eye(2) - f, g * wheel_rad[0]), np.empty(len(wheel_rad))
    before_rad = np.concatenate((wheel_rad[:1], wheel_rad[:-1]))
    for index, steer_rad in enumerate(0.5 * (before_rad + wheel_rad)):
        state = f @ state + g * steer_rad
        modelled[index] = state[1]
    kept = np.exp(-period_s / _SMOOTHED_S)
    smooth = np.column_stack([modelled, yaw_rate_rad_s])
    smooth = lfilter([1.0 - kept], [1.0, -kept], smooth - smooth[0], axis=0)
    block = np.arange(len(smooth)) * _BLOCKS // len(smooth)
    without = [_slope(*smooth[block != left_out].T) for left_out in range(_BLOCKS)]
    std = np.sqrt(_BLOCKS - 1.0) * np.std(without)
    return YawRateFit(_slope(*smooth.T), float(std)) if np.isfinite(std) else UNKNOWN


def _slope(x: FloatArray, y: FloatArray) -> float:
    """Return the slope of the line through (x, y) by least squares; NaN where x is constant."""
    around = x - x.mean()
    square = float(around @ around)
    return float(around @ y) / square if square > 0.0 else float("nan")
