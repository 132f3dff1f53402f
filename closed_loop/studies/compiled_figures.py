"""The figures of one run, in one pass of compiled code over its samples, and its verdict.

    w    deviation of the centre of gravity from the path, once a sensor period   [m]
    y    lateral error of the preview point                                      [m]
    e    error of the judged point, one of both in most studies                  [m]
         and the angle of the wheel                                              [rad]
    δ    command sent, once a control period                                     [rad]

Over the whole run: RMS and peak of w and of y, RMS and peak of δ, RMS of δ̇ (the control effort),
the settling time of e in its band, the share of control periods in which a command was at its
limits, and the latency of the commands in effect. From ``settled_s`` of the verdict on: RMS of w
and of y. Of the judged point: its peak, in the whole run and from ``settled_s`` on. Of the body:
its distance beyond an edge of its corridor, and of its lane.

At its end: the figures of ``plant_emulator.evaluation.error_windows``, from which the verdict
follows.
"""

import math
from math import nan
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
from ...plant_emulator.evaluation.held_figures import NOTHING_HELD, HeldRules, held_step
from ...plant_emulator.evaluation.run_verdict import Peaks, Verdict, VerdictRules
from ...plant_emulator.path.corridor import BETWEEN, corridor_of, outside_at
from ...plant_emulator.path.path_from_settings import build_path
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.node import NS_PER_S
from ..compiled.compilation import compiled
from ..compiled.step_functions import register, register_records

RealArray = NDArray[np.floating[Any]]
"""The type that numpy's stubs give the product of two arrays of float64."""

_TOLERANCE = 1e-9
"""Tolerance for a command at its limit: the difference of two commands is rounded."""


class Figures(NamedTuple):
    """Figures of a run; NaN where there is none."""

    duration_s: float = nan
    """Duration of the motion, up to the end of the run."""
    rms_m: float = nan
    """Of the car's deviation from the path, at its centre of gravity, as the next two."""
    peak_m: float = nan
    final_m: float = nan
    settling_s: float = nan
    """Time from which the judged point stays in its band; NaN if it is outside at the end."""
    mean_m: float = nan
    mean_before_m: float = nan
    drift_m_s: float = nan
    amplitude_m: float = nan
    amplitude_before_m: float = nan
    oscillation_rad_s: float = nan
    irregularity: float = nan
    end_peak_m: float = nan
    end_peak_before_m: float = nan
    wheel_amplitude_rad: float = nan
    wheel_amplitude_before_rad: float = nan
    wheel_oscillation_rad_s: float = nan
    wheel_irregularity: float = nan
    steer_rms_rad: float = nan
    steer_peak_rad: float = nan
    steer_rate_rms_rad_s: float = nan
    limited_share: float = nan
    preview_rms_m: float = nan
    preview_peak_m: float = nan
    latency_mean_s: float = nan
    """Of the command in effect, over the samples."""
    latency_p99_s: float = nan
    settled_rms_m: float = nan
    """From ``settled_s`` of the verdict on, as the next."""
    settled_preview_rms_m: float = nan
    judged_peak_m: float = nan
    """Of the judged point, as the next."""
    settled_peak_m: float = nan
    outside_m: float = nan
    """Of the body beyond an edge of its corridor; NaN where the path has none."""
    beyond_lane_m: float = nan
    """Of a car's body beyond an edge of its lane; NaN for a linear vehicle."""
    sensor_noise_m: float = nan
    """Its standard deviation on the lateral error."""
    grip_used_s: float = nan
    """When an axle of a car that left its lane later had first used up its grip; NaN: none had."""
    fault_s: float = nan
    """When a fault first changed a frame; this and the next two only of runs over a bus."""
    reported_s: float = nan
    """From then until it was reported on the bus."""
    reaction_s: float = nan
    """From then until a node left control."""


def _place(name: str) -> int:
    return Figures._fields.index(name)


_PEAKS, _NOISE = _place("judged_peak_m"), _place("sensor_noise_m")
_WINDOWS = [_place(name) for name in WindowFigures._fields]
COUNTS = ("samples", "commands_sent", "commands_acted", "downlink_lost", "uplink_lost")
COLUMNS = (*Figures._fields, *COUNTS)
"""Columns of the results. The counts are whole numbers: samples since the start of motion, commands
sent, commands that reached the actuator, and frames lost in each direction."""


class HandWheelFigures(NamedTuple):
    """Figures of a hand wheel; NaN while it is still."""

    hand_wheel_shakes_hz: float = nan
    hand_wheel_amplitude_rad: float = nan
    felt_delay_s: float = nan
    """Mean age of the wheel's angle that the felt torque answers; NaN for a law that needs no bus,
    and over a bus where a latency varies or loses frames, or faults act."""


HAND_WHEEL_COLUMNS = HandWheelFigures._fields
"""After the others, in a study with a hand wheel."""
HAND_WHEEL_VERDICT = "hand_wheel_verdict"
"""Column of whether it is still or shakes at the end."""
COUNTED = slice(len(Figures._fields), len(COLUMNS))
"""Where the counts are in a row."""


def figures_of(
    rules: VerdictRules,
    plant: PlantSettings,
    controller: ControllerSettings,
    time_s: RealArray,
    lateral_error_m: RealArray,
    cg_deviation_m: RealArray,
    judged_m: RealArray,
    wheel_rad: RealArray,
    sent_rad: RealArray,
) -> Figures:
    """Return the figures of one run, without those of its latency, its body and its faults.

    ``judged_m``  error of the judged point, as all others one per sensor period
    ``sent_rad``  one command per control period
    """
    if not len(time_s):
        return Figures()
    period_s, limits = plant.sensor_period_ns / NS_PER_S, controller.steer_limits
    window_s = min(rules.window_s, WINDOW_SHARE_MAX * plant.duration_s)
    held, windows = _held_and_windows(
        *(rules.settling_band_m, math.ceil(rules.settled_s / period_s)),
        *(round(window_s / period_s), period_s),
        *(lateral_error_m, cg_deviation_m, judged_m, wheel_rad),
    )
    rms_rad, peak_rad, step_rms_rad, limited_share = _effort(
        limits.steer_rad_max, limits.step_rad_max, sent_rad
    )
    return Figures(
        duration_s=float(time_s[-1]),
        rms_m=held.rms_m,
        peak_m=held.peak_m,
        final_m=held.final_m,
        settling_s=held.settled_at * period_s if held.settled_at < held.samples else nan,
        **windows._asdict(),
        steer_rms_rad=rms_rad,
        steer_peak_rad=peak_rad,
        steer_rate_rms_rad_s=step_rms_rad / (controller.period_ns / NS_PER_S),
        limited_share=limited_share,
        preview_rms_m=held.preview_rms_m,
        preview_peak_m=held.preview_peak_m,
        settled_rms_m=held.settled_rms_m,
        settled_preview_rms_m=held.settled_preview_rms_m,
        judged_peak_m=held.judged_peak_m,
        settled_peak_m=held.settled_peak_m if held.settled else nan,
        sensor_noise_m=plant.sensor_noise.lateral_error_m,
    )


class LatencyFigures(NamedTuple):
    """Of the command in effect, over the samples; NaN where there was none."""

    latency_mean_s: float = nan
    latency_p99_s: float = nan


def latency_figures(latency_s: RealArray) -> LatencyFigures:
    """Return mean and 99th percentile, the shortest latency that 99 % of the samples keep to.

    ``latency_s``  of the command in effect at each sample; NaN before the first
    """
    known_s = latency_s[~np.isnan(latency_s)]
    count = len(known_s)
    if not count:
        return LatencyFigures()
    if known_s.min() == known_s.max():
        return LatencyFigures(float(known_s[0]), float(known_s[0]))
    rank = math.ceil(0.99 * count) - 1
    return LatencyFigures(float(known_s.mean()), float(np.partition(known_s, rank)[rank]))


register_records()
register(window_figures, held_step)


@compiled
def _held_and_windows(
    band_m: float, settled_after: int, window: int, period_s: float,
    error_m: Any, cg_m: Any, judged_m: Any, wheel_rad: Any,
) -> Any:  # fmt: skip
    windows = window_figures(judged_m, wheel_rad, window, period_s)
    rules, held = HeldRules(band_m, settled_after), NOTHING_HELD
    for k in range(len(error_m)):
        held = held_step(rules, held, error_m[k], cg_m[k], judged_m[k], wheel_rad[k])
    return held, windows


@compiled
def _effort(steer_rad_max: float, step_rad_max: float, sent_rad: Any) -> Any:
    """Return RMS, peak, RMS of the steps, and share at a limit; the first step counts from 0."""
    count = len(sent_rad)
    if count == 0:
        return math.nan, math.nan, math.nan, math.nan
    square, peak, step_square, limited = 0.0, 0.0, 0.0, 0
    angle_rad = steer_rad_max * (1.0 - _TOLERANCE)
    step_rad = step_rad_max * (1.0 - _TOLERANCE)
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
    return math.sqrt(square / count), peak, math.sqrt(step_square / count), limited / count


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


def verdicts(rules: VerdictRules, ends: IntArray, figures: FloatArray) -> list[Verdict]:
    """Return the verdict of each run.

    ``ends``     shape (runs,), places in ``RUN_ENDS``
    ``figures``  shape (runs, figures), in the order of ``Figures``
    """
    peaks_m = figures[:, _PEAKS : _PEAKS + len(Peaks._fields)]
    return run_verdict.verdicts(rules, ends, figures[:, _NOISE], peaks_m, figures[:, _WINDOWS])
