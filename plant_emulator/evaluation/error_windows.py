"""The end of a run: means, amplitude and rhythm of lateral error and wheel in two windows.

``mean_m`` and ``mean_before_m`` are the means of the straight lines fitted to the lateral error of
the last window and of the one before (``amplitude_and_rhythm``), ``drift_m_s`` is the difference of
the two over the window's length. The peaks of the two windows are those of the error itself. The
windows of the wheel's fast motion end half of FAST_S earlier.

Plain arithmetic on any sequence of floats: the plant runs it as it is, studies run it compiled.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from .amplitude_and_rhythm import (
    HALF_PERIODS_MIN,
    WHEEL_HALF_PERIODS_MIN,
    amplitude_and_rhythm,
    fast_half,
    fast_motion,
)

WINDOW_SHARE_MAX = 0.25
"""Share of the run: the two windows at its end leave the first half to settle."""
SAMPLES_MIN = 8
"""A window needs as many samples."""


class WindowFigures(NamedTuple):
    """Figures of the two windows; NaN where there is none."""

    mean_m: float
    mean_before_m: float
    drift_m_s: float
    amplitude_m: float
    amplitude_before_m: float
    oscillation_rad_s: float
    irregularity: float
    end_peak_m: float
    """The largest magnitude of the error in the last window; a run too short for two is one."""
    end_peak_before_m: float
    wheel_amplitude_rad: float
    """Of the wheel's fast motion, as the next three."""
    wheel_amplitude_before_rad: float
    wheel_oscillation_rad_s: float
    wheel_irregularity: float


def window_figures(
    error_m: Sequence[float], wheel_rad: Sequence[float], window: int, period_s: float
) -> WindowFigures:
    """Return the figures of the last two windows of ``window`` samples, ``period_s`` apart."""
    samples = len(error_m)
    nan = math.nan
    if window < SAMPLES_MIN or 2 * window > samples:
        peak_m = largest(error_m, 0, samples)
        return WindowFigures(nan, nan, nan, nan, nan, nan, nan, peak_m, nan, nan, nan, nan, nan)
    first, middle = samples - 2 * window, samples - window
    before, last, omega_rad_s, irregularity = amplitude_and_rhythm(
        error_m, first, window, period_s, HALF_PERIODS_MIN
    )
    wheel_amplitude_rad = wheel_before_rad = wheel_omega_rad_s = wheel_irregularity = nan
    half = fast_half(window, period_s)
    if len(wheel_rad) >= 2 * (window + half):
        fast_rad = fast_motion(wheel_rad, 2 * window, half)
        wheel_before, wheel_last, wheel_omega_rad_s, wheel_irregularity = amplitude_and_rhythm(
            fast_rad, 0, window, period_s, WHEEL_HALF_PERIODS_MIN
        )
        wheel_amplitude_rad, wheel_before_rad = wheel_last[2], wheel_before[2]
    return WindowFigures(
        last[0],
        before[0],
        (last[0] - before[0]) / (window * period_s),
        last[2],
        before[2],
        omega_rad_s,
        irregularity,
        largest(error_m, middle, window),
        largest(error_m, first, window),
        wheel_amplitude_rad,
        wheel_before_rad,
        wheel_omega_rad_s,
        wheel_irregularity,
    )


def largest(error_m: Sequence[float], first: int, window: int) -> float:
    """Return the largest magnitude in a window."""
    peak = 0.0
    for k in range(first, first + window):
        peak = max(peak, abs(error_m[k]))
    return peak
