"""Figures of one run, in one pass of compiled code over its samples.

    y    lateral error, once a sensor period      [m]
    δ    command sent, once a control period      [rad]

Over the whole run: RMS and peak of y, RMS and peak of δ, RMS of δ̇ (the control effort), the
settling time of y in its band, the share of control periods in which a command was at its limits,
and the latency of the commands in effect.

At its end: the last two windows of ``window_s`` each are fitted by straight lines,

    y = m + d (t − t_middle) + e

so that the lines contain the slowly changing error that the path causes, and e contains the loop's
own motion. ``mean_m`` and ``mean_before_m`` are m of the last window and of the one before;
``drift_m_s`` = (m − m_before)/window; the amplitudes are √2 times the RMS of e. The peaks of the
two windows are those of y itself. For the peak, a run too short for two windows is one window.

An oscillation is distinguished from noise by its half periods: e crosses zero and exceeds 0.3 of
the amplitude on the other side. ``oscillation_rad_s`` is π over the mean of the half periods that
lie in either window, ``irregularity`` their standard deviation over their mean. With two periods in
a window both are accurate to 5 % and 0.2, with more they are better.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled.compilation import compiled
from ..controller.settings import ControllerSettings, limits_of
from ..plant_emulator.settings import PlantSettings
from ..runtime.node import NS_PER_S

FloatArray = NDArray[np.floating[Any]]
"""The type that numpy's stubs give the product of two arrays of float64."""

WINDOW_SHARE_MAX = 0.25
"""Share of the run: the two windows at its end leave the first half to settle."""
HALF_PERIODS_MIN = 4
"""Fewer half periods are no oscillation: its figures are then NaN."""
_HYSTERESIS = 0.3
_TOLERANCE = 1e-9
"""Tolerance for a command at its limit: the difference of two commands is rounded."""


class Figures(NamedTuple):
    """Figures of a run; NaN where there is none."""

    duration_s: float
    """Duration of the motion, up to the end of the run."""
    rms_m: float
    peak_m: float
    final_m: float
    settling_s: float
    """Time from which the error stays in its band; NaN if it is outside at the end."""
    mean_m: float
    mean_before_m: float
    drift_m_s: float
    amplitude_m: float
    amplitude_before_m: float
    oscillation_rad_s: float
    irregularity: float
    end_peak_m: float
    """The largest magnitude of the error in the last window."""
    end_peak_before_m: float
    steer_rms_rad: float
    steer_peak_rad: float
    steer_rate_rms_rad_s: float
    limited_share: float
    latency_mean_s: float
    """Of the command in effect, over the samples."""
    latency_p99_s: float


COUNTS = (
    "samples",
    "commands_sent",
    "commands_acted",
    "downlink_lost",
    "uplink_lost",
)
COLUMNS = (*Figures._fields, *COUNTS)
"""Columns of the results. The counts are whole numbers: samples since the start of motion, commands
sent, commands that reached the actuator, and frames lost in each direction."""


class LatencyFigures(NamedTuple):
    """Of the command in effect, over the samples; NaN where there was none."""

    mean_s: float
    p99_s: float


class FigureRules(NamedTuple):
    """The rules by which the figures are computed."""

    sensor_period_s: float
    control_period_s: float
    steer_rad_max: float
    step_rad_max: float
    window_s: float
    settling_band_m: float


def figure_rules(
    plant: PlantSettings, controller: ControllerSettings, window_s: float, settling_band_m: float
) -> FigureRules:
    """Return the rules for the figures of a run of these settings."""
    limits = limits_of(controller)
    return FigureRules(
        plant.sensor_period_ns / NS_PER_S,
        controller.period_ns / NS_PER_S,
        limits.steer_rad_max,
        limits.step_rad_max,
        min(window_s, WINDOW_SHARE_MAX * plant.duration_s),
        settling_band_m,
    )


def take_figures(
    rules: FigureRules,
    time_s: FloatArray,
    lateral_error_m: FloatArray,
    sent_rad: FloatArray,
    latency: LatencyFigures,
    row: FloatArray,
) -> None:
    """Write the figures of a run into ``row``, shape (len(Figures._fields),).

    ``time_s``, ``lateral_error_m``  one per sensor period
    ``sent_rad``                     one command per control period
    """
    row[:] = math.nan
    row[-2:] = latency
    if len(time_s):
        _figures(rules, time_s, lateral_error_m, sent_rad, row)


def latency_figures(latency_s: FloatArray) -> LatencyFigures:
    """Return mean and 99th percentile, the shortest latency that 99 % of the samples keep to.

    ``latency_s``  of the command in effect at each sample; NaN before the first
    """
    known_s = latency_s[~np.isnan(latency_s)]
    count = len(known_s)
    if not count:
        return LatencyFigures(math.nan, math.nan)
    if known_s.min() == known_s.max():
        return LatencyFigures(float(known_s[0]), float(known_s[0]))
    rank = math.ceil(0.99 * count) - 1
    return LatencyFigures(float(known_s.mean()), float(np.partition(known_s, rank)[rank]))


def figures_of(
    rules: FigureRules,
    time_s: FloatArray,
    lateral_error_m: FloatArray,
    sent_rad: FloatArray,
    latency_s: FloatArray,
) -> Figures:
    """Return the figures of one run."""
    row = np.empty(len(Figures._fields))
    take_figures(rules, time_s, lateral_error_m, sent_rad, latency_figures(latency_s), row)
    return Figures(*row.tolist())


@compiled
def _figures(rules: Any, time_s: Any, error_m: Any, sent_rad: Any, row: Any) -> None:
    samples = len(time_s)
    row[0] = time_s[samples - 1]
    square, peak, outside = 0.0, 0.0, -1
    for k in range(samples):
        value = error_m[k]
        square += value * value
        magnitude = abs(value)
        if magnitude > peak:
            peak = magnitude
        if magnitude > rules.settling_band_m:
            outside = k
    row[1] = math.sqrt(square / samples)
    row[2] = row[12] = peak
    row[3] = error_m[samples - 1]
    if outside < 0:
        row[4] = 0.0
    elif outside + 1 < samples:
        row[4] = time_s[outside + 1]
    _end(rules, error_m, row)
    _effort(rules, sent_rad, row)


@compiled
def _end(rules: Any, error_m: Any, row: Any) -> None:
    """Write means, drift, amplitudes and the oscillation of the two windows at the end."""
    samples = len(error_m)
    window = round(rules.window_s / rules.sensor_period_s)
    if window < 8 or 2 * window > samples:
        return
    first, middle = samples - 2 * window, samples - window
    before = _line(error_m, first, window)
    last = _line(error_m, middle, window)
    row[5], row[6] = last[0], before[0]
    row[7] = (last[0] - before[0]) / (window * rules.sensor_period_s)
    row[8], row[9] = last[2], before[2]
    row[12] = _peak(error_m, middle, window)
    row[13] = _peak(error_m, first, window)
    level = _HYSTERESIS * min(last[2], before[2])
    halves, total, square = 0, 0.0, 0.0
    # Each window by itself: the step between the two lines is no zero crossing.
    for begin, line in ((first, before), (middle, last)):
        count, length, squares = _half_periods(error_m, begin, window, line, level)
        halves += count
        total += length
        square += squares
    if halves >= HALF_PERIODS_MIN:
        mean = total / halves
        row[10] = math.pi / (mean * rules.sensor_period_s)
        row[11] = math.sqrt(max(square / halves - mean * mean, 0.0)) / mean


@compiled
def _peak(error_m: Any, first: Any, window: Any) -> Any:
    """Return the largest magnitude in a window."""
    peak = 0.0
    for k in range(first, first + window):
        peak = max(peak, abs(error_m[k]))
    return peak


@compiled
def _half_periods(error_m: Any, first: Any, window: Any, line: Any, level: Any) -> Any:
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


@compiled
def _line(error_m: Any, first: Any, window: Any) -> Any:
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


@compiled
def _effort(rules: Any, sent_rad: Any, row: Any) -> None:
    """Write the figures of the commands; the first step counts from 0."""
    if len(sent_rad) == 0:
        return
    square, peak, step_square, limited = 0.0, 0.0, 0.0, 0
    angle_rad = rules.steer_rad_max * (1.0 - _TOLERANCE)
    step_rad = rules.step_rad_max * (1.0 - _TOLERANCE)
    previous = 0.0
    for k in range(len(sent_rad)):
        value = sent_rad[k]
        step = value - previous
        previous = value
        square += value * value
        step_square += step * step
        peak = max(peak, abs(value))
        if abs(value) >= angle_rad or abs(step) >= step_rad:
            limited += 1
    row[14] = math.sqrt(square / len(sent_rad))
    row[15] = peak
    row[16] = math.sqrt(step_square / len(sent_rad)) / rules.control_period_s
    row[17] = limited / len(sent_rad)
