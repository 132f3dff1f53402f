"""The end of a run: means, amplitude and rhythm of lateral error and wheel in two windows.

Each window is fitted by a straight line,

    y = m + d (t − t_middle) + e

so that the lines contain what changes slowly, as the path asks, and e contains the loop's own
motion. The amplitudes are √2 times the RMS of e. ``mean_m`` and ``mean_before_m`` are the means of
the lines of the last window and of the one before, ``drift_m_s`` is the difference of the two over
the window's length. The peaks of the two windows are those of the error itself.

Whether it oscillates is for the verdict (``run_verdict``) to say. The rhythm is that of the half
periods: in each, e crosses zero and exceeds 0.3 of the amplitude on the other side. The frequency
is π over the mean of the half periods that lie in either window, the irregularity their standard
deviation over their mean. With two periods in a window both are accurate to 5 % and 0.2, with more
they are better.

The wheel's oscillation is measured in its fast motion, the angle less its mean over FAST_S about
each sample: no path asks for that, while a loop that oscillates faster than the vehicle can follow
shows little of it in the lateral error. Its windows end half of FAST_S earlier.

Plain arithmetic on any sequence of floats: the plant runs it as it is, studies run it compiled.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

WINDOW_SHARE_MAX = 0.25
"""Share of the run: the two windows at its end leave the first half to settle."""
SAMPLES_MIN = 8
"""A window needs as many samples."""
HALF_PERIODS_MIN = 4
"""Fewer half periods are no rhythm: its figures are then NaN."""
WHEEL_HALF_PERIODS_MIN = 12
"""Swings of the wheel for a rhythm. Noise moves the wheel too: fewer may look like a rhythm."""
FAST_S = 1.0
"""A slower motion of the wheel follows the path; at most the length of a window."""
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
    means_m = last[0], before[0], (last[0] - before[0]) / (window * period_s)
    peaks_m = largest(error_m, middle, window), largest(error_m, first, window)
    swings = last[2], before[2], omega_rad_s, irregularity
    wheel = wheel_amplitude_rad, wheel_before_rad, wheel_omega_rad_s, wheel_irregularity
    return WindowFigures(*means_m, *swings, *peaks_m, *wheel)


def largest(error_m: Sequence[float], first: int, window: int) -> float:
    """Return the largest magnitude in a window."""
    peak = 0.0
    for k in range(first, first + window):
        peak = max(peak, abs(error_m[k]))
    return peak


def fast_half(window: int, period_s: float) -> int:
    """Return how many samples on either side the mean of a fast motion covers."""
    return min(round(0.5 * FAST_S / period_s), window // 2)


def fast_motion(values: Sequence[float], count: int, half: int) -> list[float]:
    """Return the last ``count`` values that have ``half`` others on either side, less the mean."""
    first = len(values) - half - count
    width = 2 * half + 1
    total = 0.0
    for k in range(first - half, first + half):
        total += values[k]
    fast = [0.0] * count
    for k in range(count):
        total += values[first + k + half]
        fast[k] = values[first + k] - total / width
        total -= values[first + k - half]
    return fast


def amplitude_and_rhythm(
    values: Sequence[float], first: int, window: int, period_s: float, halves_min: int
) -> tuple[tuple[float, float, float], tuple[float, float, float], float, float]:
    """Return the lines fitted to two windows, and frequency and irregularity of what is left.

    ``halves_min``  half periods that both figures need; NaN with fewer
    """
    middle = first + window
    before = fitted_line(values, first, window)
    last = fitted_line(values, middle, window)
    level = _HYSTERESIS * min(last[2], before[2])
    halves, total, square = 0, 0.0, 0.0
    # Each window by itself: the step between the two lines is no zero crossing.
    for begin, line in ((first, before), (middle, last)):
        count, length, squares = half_periods(values, begin, window, line, level)
        halves += count
        total += length
        square += squares
    omega_rad_s, irregularity = math.nan, math.nan
    if halves >= halves_min:
        mean = total / halves
        omega_rad_s = math.pi / (mean * period_s)
        irregularity = math.sqrt(max(square / halves - mean * mean, 0.0)) / mean
    return before, last, omega_rad_s, irregularity


def half_periods(
    values: Sequence[float], first: int, window: int, line: tuple[float, float, float], level: float
) -> tuple[int, float, float]:
    """Return number, sum and sum of squares of the half periods in a window, in samples."""
    centre = 0.5 * (window - 1)
    side, crossed, turned = 0, -1, -1  # turned: where e last crossed zero
    halves, total, square = 0, 0.0, 0.0
    previous = 0.0
    for k in range(window):
        e = values[first + k] - line[0] - line[1] * (k - centre)
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


def fitted_line(values: Sequence[float], first: int, window: int) -> tuple[float, float, float]:
    """Return mean, slope per sample and √2 times the RMS distance of the fitted line."""
    centre = 0.5 * (window - 1)
    total, moment = 0.0, 0.0
    for k in range(window):
        value = values[first + k]
        total += value
        moment += value * (k - centre)
    mean = total / window
    slope = moment / (window * (window * window - 1.0) / 12.0)
    square = 0.0
    for k in range(window):
        e = values[first + k] - mean - slope * (k - centre)
        square += e * e
    return mean, slope, math.sqrt(2.0 * square / window)
