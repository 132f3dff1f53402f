"""The figures of one run, in one pass of compiled code over its samples, and its verdict.

    y    lateral error of the preview point, once a sensor period      [m]
         and with it that of the followed point, which is judged       [m]
         and the angle of the wheel                                    [rad]
    w    deviation of the centre of gravity, every CG_STRIDE periods   [m]
    δ    command sent, once a control period                           [rad]

Over the whole run: RMS and peak of y and of w, RMS and peak of δ, RMS of δ̇ (the control effort),
the settling time of y in its band, the share of control periods in which a command was at its
limits, and the latency of the commands in effect. From SETTLED_S on: RMS of y and of w. Of the
followed point: its peak, in the whole run and from ``settled_s`` of the verdict on. Of the body:
its distance beyond an edge of its corridor.

At its end: the figures of ``plant_emulator.evaluation.error_windows``, from which the verdict
follows.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controller.settings import ControllerSettings
from ...plant_emulator.evaluation import run_verdict
from ...plant_emulator.evaluation.error_windows import (
    WINDOW_SHARE_MAX,
    WindowFigures,
    window_figures,
)
from ...plant_emulator.evaluation.judged_point import behind_preview_m
from ...plant_emulator.evaluation.run_verdict import RUN_ENDS, Peaks, RunEnd, Verdict, VerdictRules
from ...plant_emulator.path.corridor import BETWEEN, corridor_of, outside_at
from ...plant_emulator.path.path_from_settings import build_path
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.node import NS_PER_S
from ..compiled.compilation import compiled
from ..compiled.step_functions import register
from ..pair.agreed_point import followed_point

RealArray = NDArray[np.floating[Any]]
"""The type that numpy's stubs give the product of two arrays of float64."""

CG_STRIDE = 10
"""The centre of gravity hardly moves in a sensor period; its deviation takes long to compute."""
SETTLED_S = 5.0
"""Time by which a run that begins in a bend has settled."""
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
    end_peak_before_m: float
    wheel_amplitude_rad: float
    wheel_amplitude_before_rad: float
    wheel_oscillation_rad_s: float
    wheel_irregularity: float
    steer_rms_rad: float
    steer_peak_rad: float
    steer_rate_rms_rad_s: float
    limited_share: float
    cg_rms_m: float
    """Of the centre of gravity; all other figures of an error are the preview point's."""
    cg_peak_m: float
    latency_mean_s: float
    """Of the command in effect, over the samples."""
    latency_p99_s: float
    settled_rms_m: float
    """From SETTLED_S on."""
    settled_cg_rms_m: float
    followed_peak_m: float
    """Of the followed point, as the next."""
    settled_peak_m: float
    outside_m: float
    """Of the body beyond an edge of its corridor; NaN where the path has none."""
    sensor_noise_m: float
    """Its standard deviation on the lateral error."""
    fault_s: float
    """When a fault first changed a frame; this and the next two only of runs over a bus."""
    reported_s: float
    """From then until it was reported on the bus."""
    reaction_s: float
    """From then until a node left control."""


def _place(name: str) -> int:
    return Figures._fields.index(name)


_PEAKS, _NOISE = _place("followed_peak_m"), _place("sensor_noise_m")
COUNTS = ("samples", "commands_sent", "commands_acted", "downlink_lost", "uplink_lost")
COLUMNS = (*Figures._fields, *COUNTS)
"""Columns of the results. The counts are whole numbers: samples since the start of motion, commands
sent, commands that reached the actuator, and frames lost in each direction."""


class LatencyFigures(NamedTuple):
    """Of the command in effect, over the samples; NaN where there was none."""

    mean_s: float
    p99_s: float


NO_LATENCY = LatencyFigures(math.nan, math.nan)


class FigureRules(NamedTuple):
    """The rules by which the figures are computed."""

    sensor_period_s: float
    control_period_s: float
    steer_rad_max: float
    step_rad_max: float
    window_s: float
    settling_band_m: float
    settled_s: float = VerdictRules().settled_s
    behind_preview_m: float = 0.0
    """Of the followed point."""
    sensor_noise_m: float = 0.0


def figures_of(
    rules: FigureRules,
    time_s: RealArray,
    lateral_error_m: RealArray,
    followed_m: RealArray,
    wheel_rad: RealArray,
    cg_deviation_m: RealArray,
    sent_rad: RealArray,
    latency: LatencyFigures = NO_LATENCY,
    outside_m: float = math.nan,
) -> Figures:
    """Return the figures of one run.

    ``time_s``, ``lateral_error_m``, ``followed_m``, ``wheel_rad``  one per sensor period
    ``cg_deviation_m``  one per CG_STRIDE of them
    ``sent_rad``        one command per control period
    """
    nan = math.nan
    if not len(time_s):
        blank = Figures(*[nan] * len(Figures._fields))
        return blank._replace(
            latency_mean_s=latency.mean_s, latency_p99_s=latency.p99_s, outside_m=outside_m
        )
    first = int(np.searchsorted(time_s[::CG_STRIDE], SETTLED_S))
    moved = time_s, lateral_error_m, followed_m, wheel_rad
    whole, settled_rms_m, windows, effort, peaks = _moved_figures(rules, *moved, sent_rad)
    return Figures._make(
        (
            *(*whole, *windows, *effort),
            *(_rms(cg_deviation_m), float(np.max(np.abs(cg_deviation_m)))),
            *latency,
            *(settled_rms_m, _rms(cg_deviation_m[first:])),
            *(*peaks, outside_m, rules.sensor_noise_m, nan, nan, nan),
        )
    )


def _rms(values: RealArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan


def latency_figures(latency_s: RealArray) -> LatencyFigures:
    """Return mean and 99th percentile, the shortest latency that 99 % of the samples keep to.

    ``latency_s``  of the command in effect at each sample; NaN before the first
    """
    known_s = latency_s[~np.isnan(latency_s)]
    count = len(known_s)
    if not count:
        return NO_LATENCY
    if known_s.min() == known_s.max():
        return LatencyFigures(float(known_s[0]), float(known_s[0]))
    rank = math.ceil(0.99 * count) - 1
    return LatencyFigures(float(known_s.mean()), float(np.partition(known_s, rank)[rank]))


register(window_figures)


@compiled
def _moved_figures(
    rules: Any, time_s: Any, error_m: Any, followed_m: Any, wheel_rad: Any, sent_rad: Any
) -> Any:
    window = round(rules.window_s / rules.sensor_period_s)
    whole, settled_rms_m = _errors(rules, time_s, error_m)
    windows = window_figures(followed_m, wheel_rad, window, rules.sensor_period_s)
    effort, peaks = _effort(rules, sent_rad), _peaks(rules, time_s, followed_m)
    return whole, settled_rms_m, windows, effort, peaks


@compiled
def _errors(rules: Any, time_s: Any, error_m: Any) -> Any:
    """Return duration, RMS, peak, last error and settling time, and the RMS from SETTLED_S on."""
    samples = len(time_s)
    square, peak, outside = 0.0, 0.0, -1
    settled_square, settled = 0.0, 0
    for k in range(samples):
        value = error_m[k]
        square += value * value
        if time_s[k] >= SETTLED_S:
            settled_square += value * value
            settled += 1
        magnitude = abs(value)
        if magnitude > peak:
            peak = magnitude
        if magnitude > rules.settling_band_m:
            outside = k
    settling_s = 0.0 if outside < 0 else math.nan
    if 0 < outside + 1 < samples:
        settling_s = time_s[outside + 1]
    settled_rms_m = math.sqrt(settled_square / settled) if settled else math.nan
    rms_m = math.sqrt(square / samples)
    return (time_s[samples - 1], rms_m, peak, error_m[samples - 1], settling_s), settled_rms_m


@compiled
def _peaks(rules: Any, time_s: Any, followed_m: Any) -> Any:
    """Return the largest error of the whole run, and of the run from ``settled_s`` on."""
    first = np.searchsorted(time_s, rules.settled_s)
    before_m, settled_m = 0.0, 0.0
    for k in range(first):
        before_m = max(before_m, abs(followed_m[k]))
    for k in range(first, len(followed_m)):
        settled_m = max(settled_m, abs(followed_m[k]))
    return max(before_m, settled_m), settled_m if first < len(followed_m) else math.nan


@compiled
def _effort(rules: Any, sent_rad: Any) -> Any:
    """Return RMS, peak, RMS of the rate, and share at a limit; the first step counts from 0."""
    count = len(sent_rad)
    if count == 0:
        return math.nan, math.nan, math.nan, math.nan
    square, peak, step_square, limited = 0.0, 0.0, 0.0, 0
    angle_rad = rules.steer_rad_max * (1.0 - _TOLERANCE)
    step_rad = rules.step_rad_max * (1.0 - _TOLERANCE)
    previous = 0.0
    for k in range(count):
        value = sent_rad[k]
        step = value - previous
        previous = value
        square += value * value
        step_square += step * step
        peak = max(peak, abs(value))
        if abs(value) >= angle_rad or abs(step) >= step_rad:
            limited += 1
    rate_rms_rad_s = math.sqrt(step_square / count) / rules.control_period_s
    return math.sqrt(square / count), peak, rate_rms_rad_s, limited / count


_WINDOWS = [_place(name) for name in WindowFigures._fields]


def rules_of(
    rules: VerdictRules, plant: PlantSettings, controller: ControllerSettings
) -> FigureRules:
    """Return the rules for the figures of a run of these settings."""
    limits = controller.steer_limits
    point = followed_point(rules, controller)
    return FigureRules(
        plant.sensor_period_ns / NS_PER_S,
        controller.period_ns / NS_PER_S,
        limits.steer_rad_max,
        limits.step_rad_max,
        min(rules.window_s, WINDOW_SHARE_MAX * plant.duration_s),
        rules.settling_band_m,
        rules.settled_s,
        behind_preview_m(point, plant.vehicle),
        plant.sensor_noise.lateral_error_m,
    )


def farthest_outside_m(
    plant: PlantSettings, at_m: FloatArray, heading_rad: FloatArray, error_m: FloatArray
) -> float:
    """Return how far the body was beyond an edge of its corridor; NaN without one.

    ``at_m``, ``heading_rad``, ``error_m``  of the preview point, one a sample: arc length, heading
                                            and lateral error
    """
    corridor, preview_m = corridor_of(plant.path), plant.vehicle.preview_distance_m
    if corridor is None:
        return math.nan
    columns = at_m.tolist(), heading_rad.tolist(), error_m.tolist()
    path = build_path(plant.path)
    found = (outside_at(corridor, path, *row, preview_m) for row in zip(*columns, strict=True))
    return max(found, default=BETWEEN).outside_m


def short_windows(rules: VerdictRules, duration_s: float) -> str:
    """Return a warning for runs too short for the windows asked for; empty for others."""
    window_s = WINDOW_SHARE_MAX * duration_s
    if window_s >= rules.window_s:
        return ""
    return (
        f"runs of {duration_s:g} s are judged by two windows of {window_s:g} s, not of "
        f"verdict.window_s = {rules.window_s:g}: an oscillation of less than "
        f"{rules.swing_m:g} m is not seen if it is slower than {0.5 * window_s:g} s, nor growth "
        f"that takes longer; give plant.duration_s = {rules.window_s / WINDOW_SHARE_MAX:g} or more"
    )


def verdict_of(rules: VerdictRules, end: RunEnd, figures: FloatArray) -> Verdict:
    """Return the verdict of one run; ``figures`` begin in the order of ``Figures``."""
    return verdicts(rules, np.array([RUN_ENDS.index(end)]), figures[None])[0]


def verdicts(rules: VerdictRules, ends: IntArray, figures: FloatArray) -> list[Verdict]:
    """Return the verdict of each run.

    ``ends``     shape (runs,), places in ``RUN_ENDS``
    ``figures``  shape (runs, figures), in the order of ``Figures``
    """
    peaks_m = figures[:, _PEAKS : _PEAKS + len(Peaks._fields)]
    return run_verdict.verdicts(rules, ends, figures[:, _NOISE], peaks_m, figures[:, _WINDOWS])
