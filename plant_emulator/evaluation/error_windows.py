"""The end of a run: the lateral error in its last two windows, as means, drift and oscillation.

Each window is fitted by a straight line,

    y = m + d (t − t_middle) + e      y lateral error [m]

so that the lines contain the slowly changing error that the path causes, and e contains the loop's
own motion. ``mean_m`` and ``mean_before_m`` are m of the last window and of the one before;
``drift_m_s`` = (m − m_before)/window; the amplitudes are √2 times the RMS of e. The peaks of the
two windows are those of y itself.

An oscillation is distinguished from noise by its half periods: e crosses zero and exceeds 0.3 of
the amplitude on the other side. ``oscillation_rad_s`` is π over the mean of the half periods that
lie in either window, ``irregularity`` their standard deviation over their mean. With two periods in
a window both are accurate to 5 % and 0.2, with more they are better.

Plain arithmetic on any sequence of floats: the plant runs it as it is, studies run it compiled.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

WINDOW_SHARE_MAX = 0.25
"""Share of the run: the two windows at its end leave the first half to settle."""
HALF_PERIODS_MIN = 4
"""Fewer half periods are no oscillation: its figures are then NaN."""
SAMPLES_MIN = 8
"""A window of fewer samples is none."""
_HYSTERESIS = 0.3


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


def window_figures(error_m: Sequence[float], window: int, period_s: float) -> WindowFigures:
    """Return the figures of the last two windows of ``window`` samples, ``period_s`` apart."""
    samples = len(error_m)
    nan = math.nan
    if window < SAMPLES_MIN or 2 * window > samples:
        peak_m = largest(error_m, 0, samples)
        return WindowFigures(nan, nan, nan, nan, nan, nan, nan, peak_m, nan)
    first, middle = samples - 2 * window, samples - window
    before = fitted_line(error_m, first, window)
    last = fitted_line(error_m, middle, window)
    level = _HYSTERESIS * min(last[2], before[2])
    halves, total, square = 0, 0.0, 0.0
    # Each window by itself: the step between the two lines is no zero crossing.
    for begin, line in ((first, before), (middle, last)):
        count, length, squares = half_periods(error_m, begin, window, line, level)
        halves += count
        total += length
        square += squares
    omega_rad_s, irregularity = nan, nan
    if halves >= HALF_PERIODS_MIN:
        mean = total / halves
        omega_rad_s = math.pi / (mean * period_s)
        irregularity = math.sqrt(max(square / halves - mean * mean, 0.0)) / mean
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
    )


def largest(error_m: Sequence[float], first: int, window: int) -> float:
    """Return the largest magnitude in a window."""
    peak = 0.0
    for k in range(first, first + window):
        peak = max(peak, abs(error_m[k]))
    return peak


def half_periods(
    error_m: Sequence[float],
    first: int,
    window: int,
    line: tuple[float, float, float],
    level: float,
) -> tuple[int, float, float]:
    """Return number, sum and sum of squares of the half periods in a window, in samples."""
    centre = 0.5 * (window - 1)
    side, crossed, turned = 0, -1, -1  # turned: where e last crossed zero
    halves, total, square = 0, 0.0, 0.0
    previous = 0.0
    for k in range(window):
        e = error_m[first + k] - line[0] - line[1] * (k - centre)
        if e * previous < 0.0:
            turned = k
        previous = e
        now = 1 if e > level else -1 if e < -level else 0
        if now != 0 and now != side:
            if side != 0:
                if crossed >= 0:
                    half = float(turned - crossed)
                    halves += 1
                    total += half
                    square += half * half
                crossed = turned
            side = now
    return halves, total, square


def fitted_line(error_m: Sequence[float], first: int, window: int) -> tuple[float, float, float]:
    """Return mean, slope per sample and √2 times the RMS distance of the fitted line."""
    centre = 0.5 * (window - 1)
    total, moment = 0.0, 0.0
    for k in range(window):
        value = error_m[first + k]
        total += value
        moment += value * (k - centre)
    mean = total / window
    slope = moment / (window * (window * window - 1.0) / 12.0)
    square = 0.0
    for k in range(window):
        e = error_m[first + k] - mean - slope * (k - centre)
        square += e * e
    return mean, slope, math.sqrt(2.0 * square / window)
