"""The verdict on a run, from its lateral error and its wheel (``error_windows``).

The first that applies:

    no start      no measurement reached the controller, or no command the actuator
    too short     the run lasted less than SHORTEST_RUN_S: nothing can be said of it
    left range    the error exceeded the range of LATERAL_ERROR (±83.88 m), or a car left its path
    left corridor the vehicle's body was beyond an edge of the corridor (``path.corridor``)
    unstable      the law gave no finite command; or an oscillation grows: its amplitude in the last
                  window is ``growth`` times that in the window before, or more
    limit cycle   an oscillation lasts: its amplitude is at least ``sustained`` times that before
    drifts        the mean of the last window is farther from the path than that of the window
                  before, moves away at ``drift_m_s`` or faster, and is beyond ``off_path_m``
    left road     the error exceeded ``road_m`` at any time, even if it has come back; of a car:
                  a corner of its body was beyond an edge of its lane
    decays        not on the path in the last window, but the largest error there is less than
                  ``sustained`` times that in the window before: it comes back, too late
    off path      not on the path in the last window
    left path     the error exceeded ``off_path_m`` after ``settled_s``, even if it has come back;
                  where the path has no corridor
    wheel shakes  the amplitude of the wheel's fast motion in the last window is ``wheel_swing_rad``
                  or more: without a rhythm, as noise moves it, or dying away
    holds         none of these: within ``off_path_m`` from ``settled_s`` to the end

A window is on the path if the error stays within ``off_path_m`` and swings by less than
``swing_m``. So ``holds`` guarantees all of this for every run, whatever its other figures.

An oscillation of the lateral error is one of two things:

    regular   the standard deviation of the half periods is at most ``irregularity`` of their mean,
              and the amplitude is ``amplitude_m`` or more; GROWING_SHARE of it where it grows
    a swing   of ``swing_m`` or more, without a rhythm or too slow for the window to show one; it
              exceeds mean and trend (the window's largest error is at most CREST_MAX times the
              amplitude), and had an amplitude of ``amplitude_m`` or more in the window before

The last condition of a swing excludes a run that a disturbance has just struck: it is off the path,
but does not oscillate yet.

The wheel oscillates in its fast motion alone, and only regularly, by ``wheel_amplitude_rad`` or
more. A loop of 160 rad/s slams the wheel from limit to limit while the vehicle, which cannot
follow, stays within 5 mm.

Sensor noise makes every loop swing, and a resonant one with a rhythm. So an oscillation, of error
or wheel, has an amplitude of at least NOISE_GAIN times the noise.

The lateral error here is the true deviation of ``judged_point`` from the path, without noise and
resolution of a measurement. A loop that is unstable in the linear sense reaches the limits of its
commands sooner or later and then stays in a limit cycle: both verdicts mean that it does not hold.
"""

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from ...dbc.messages import LateralError, limits
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.settings import Settings
from ..vehicle.settings import VehicleSettings
from .error_windows import WINDOW_SHARE_MAX, WindowFigures, fast_half, window_figures

JudgedPoint = Literal["preview", "centre_of_gravity", "rear_axle"]
"""The car is where its centre of gravity is; the preview point lies ahead of it."""
NOISE_GAIN = 6.0
"""Amplitude that white noise may cause over its standard deviation, of the error [m/m] and of the
wheel [rad/m]. Laws designed for noise of 20 mm move the wheel by 3.2 rad/m (RMS), and less where
its rate is limited. Among loops drawn at random, six left the fewest wrong verdicts."""
GROWING_SHARE = 0.25
"""Of the amplitude of an oscillation, from which a regular one that grows is unstable already, if
noise does not explain it."""
CREST_MAX = 3.0
"""Largest error over amplitude of a swing: 1 for a sine about the path, √3/√2 for a triangle, 1.7
where it dies away to a fifth within the window."""


SHORTEST_RUN_S = 1.0
"""The windows of a shorter run, a quarter of it each, show no swing of a vehicle."""
RANGE_M = limits(LateralError)["lateral_error_m"].maximum
"""Largest error that LATERAL_ERROR can carry."""


class Verdict(StrEnum):
    """The verdict on a run."""

    NO_START = "no start"
    TOO_SHORT = "too short"
    LEFT_RANGE = "left range"
    LEFT_CORRIDOR = "left corridor"
    UNSTABLE = "unstable"
    LIMIT_CYCLE = "limit cycle"
    DRIFTS = "drifts"
    LEFT_ROAD = "left road"
    DECAYS = "decays"
    OFF_PATH = "off path"
    LEFT_PATH = "left path"
    WHEEL_SHAKES = "wheel shakes"
    HOLDS = "holds"


class RunEnd(StrEnum):
    """How a run can end; the number of an end is its place in this list."""

    COMPLETE = "complete"
    LEFT_RANGE = "left range"
    CONTROLLER_FAILED = "controller failed"
    """Its law, or what it watches: implausible signals, a program that ends."""
    NO_START = "no start"
    TOO_SHORT = "too short"


RUN_ENDS = tuple(RunEnd)


def end_of(end: RunEnd, duration_s: float) -> RunEnd:
    """Return how a run ended, given how it ended if it was long enough."""
    return RunEnd.TOO_SHORT if end is RunEnd.COMPLETE and duration_s < SHORTEST_RUN_S else end


class VerdictRules(Settings):
    """``[verdict]``: the point that is judged, and thresholds, with their defaults."""

    judged_point: JudgedPoint = "centre_of_gravity"
    settled_s: float = Field(5.0, ge=0.0, le=10_000.0)
    """By then a run that begins in a bend has settled."""
    window_s: float = Field(15.0, gt=0.0, le=10_000.0)
    """Length of each of the two windows at the end of a run; at most a quarter of the run."""
    settling_band_m: float = Field(0.1, gt=0.0, le=100.0)
    off_path_m: float = Field(0.25, gt=0.0, le=100.0)
    """By design PD leaves up to 0.16 m in bends and under lasting disturbances; this is half as
    much again.
    """
    road_m: float = Field(1.75, gt=0.0, le=100.0)
    """Half a lane of 3.5 m."""
    amplitude_m: float = Field(0.02, gt=0.0, le=100.0)
    swing_m: float = Field(0.1, gt=0.0, le=100.0)
    growth: float = Field(1.5, gt=1.0, le=1000.0)
    sustained: float = Field(0.8, gt=0.0, le=1.0)
    wheel_amplitude_rad: float = Field(0.02, gt=0.0, le=10.0)
    wheel_swing_rad: float = Field(0.2, gt=0.0, le=10.0)
    """Noise of 20 mm moves the wheel by 0.05 rad under the laws designed for it."""
    irregularity: float = Field(0.4, gt=0.0, le=10.0)
    drift_m_s: float = Field(0.005, gt=0.0, le=100.0)

    def behind_preview_m(self, vehicle: VehicleSettings) -> float:
        """Return how far the judged point lies behind the preview point."""
        preview_m = vehicle.preview_distance_m
        rear_m = preview_m + vehicle.rear_axle_distance_m
        places_m = {"preview": 0.0, "centre_of_gravity": preview_m, "rear_axle": rear_m}
        return places_m[self.judged_point]


class Peaks(NamedTuple):
    """Largest magnitudes of the judged point's error [m].

    ``settled_m``  from ``settled_s`` on; NaN for a shorter run
    ``outside_m``  of the body, beyond an edge of its corridor; NaN where the path has none
    ``beyond_lane_m``  of the body, beyond an edge of its lane; NaN for a vehicle without a body
    """

    whole_m: float
    settled_m: float
    outside_m: float = math.nan
    beyond_lane_m: float = math.nan


def verdicts(
    rules: VerdictRules,
    ends: IntArray,
    noise_m: FloatArray,
    peaks_m: FloatArray,
    windows: FloatArray,
) -> list[Verdict]:
    """Return the verdict of each run.

    ``ends``     shape (runs,), places in ``RUN_ENDS``
    ``noise_m``  shape (runs,), standard deviation of the sensor's noise on the lateral error
    ``peaks_m``  shape (runs, 4), in the order of ``Peaks``
    ``windows``  shape (runs, figures), in the order of ``WindowFigures``
    """

    def column(name: str) -> Any:
        return windows[:, WindowFigures._fields.index(name)]

    def ended(end: RunEnd) -> Any:
        return ends == RUN_ENDS.index(end)

    amplitude_m, before_m = column("amplitude_m"), column("amplitude_before_m")
    wheel_rad = column("wheel_amplitude_rad")
    wheel_before_rad = column("wheel_amplitude_before_rad")
    peak_m, peak_before_m = column("end_peak_m"), column("end_peak_before_m")
    by_noise = NOISE_GAIN * noise_m
    # Comparisons with NaN are false: without the figure a run does not show the behaviour.
    has_rhythm = column("irregularity") <= rules.irregularity
    wheel_has_rhythm = column("wheel_irregularity") <= rules.irregularity
    swings = amplitude_m >= rules.swing_m
    is_about_path = (peak_m <= CREST_MAX * amplitude_m) & (before_m >= rules.amplitude_m)
    is_large = amplitude_m >= np.maximum(rules.amplitude_m, by_noise)
    oscillates = is_large & (has_rhythm | (swings & is_about_path))
    wheel_is_large = wheel_rad >= np.maximum(rules.wheel_amplitude_rad, by_noise)
    wheel_oscillates = wheel_is_large & wheel_has_rhythm
    begins = has_rhythm & (amplitude_m >= np.maximum(GROWING_SHARE * rules.amplitude_m, by_noise))
    wheel_begins = wheel_has_rhythm & (
        wheel_rad >= np.maximum(GROWING_SHARE * rules.wheel_amplitude_rad, by_noise)
    )
    grows = amplitude_m >= rules.growth * before_m
    wheel_grows = wheel_rad >= rules.growth * wheel_before_rad
    mean_m, drift_m_s = column("mean_m"), column("drift_m_s")
    is_farther = np.abs(mean_m) > np.maximum(rules.off_path_m, np.abs(column("mean_before_m")))
    drifts = is_farther & (drift_m_s * np.sign(mean_m) >= rules.drift_m_s)
    outside_m, lane_m = peaks_m[:, 2], peaks_m[:, 3]
    is_off = swings | ~(peak_m <= rules.off_path_m)
    conditions = {
        Verdict.NO_START: ended(RunEnd.NO_START),
        Verdict.TOO_SHORT: ended(RunEnd.TOO_SHORT),
        Verdict.LEFT_RANGE: ended(RunEnd.LEFT_RANGE),
        Verdict.LEFT_CORRIDOR: outside_m > 0.0,
        Verdict.UNSTABLE: ended(RunEnd.CONTROLLER_FAILED)
        | ((oscillates | begins) & grows)
        | (wheel_begins & wheel_grows),
        Verdict.LIMIT_CYCLE: (oscillates & (amplitude_m >= rules.sustained * before_m))
        | (wheel_oscillates & (wheel_rad >= rules.sustained * wheel_before_rad)),
        Verdict.DRIFTS: drifts,
        Verdict.LEFT_ROAD: np.where(np.isnan(lane_m), peaks_m[:, 0] > rules.road_m, lane_m > 0.0),
        Verdict.DECAYS: is_off & (peak_m < rules.sustained * peak_before_m),
        Verdict.OFF_PATH: is_off,
        Verdict.LEFT_PATH: np.isnan(outside_m) & (peaks_m[:, 1] > rules.off_path_m),
        Verdict.WHEEL_SHAKES: wheel_rad >= rules.wheel_swing_rad,
    }
    names = list(conditions)
    chosen = np.select(list(conditions.values()), range(len(names)), default=len(names))
    return [(*names, Verdict.HOLDS)[place] for place in chosen.tolist()]


class JudgedRun(NamedTuple):
    """A verdict, and the figures that explain it.

    ``window_s``  length of each of the two windows at the end of the run
    """

    verdict: Verdict
    window_s: float
    windows: WindowFigures

    def report(self) -> Mapping[str, Any]:
        """Return verdict and figures, ready for JSON; None for a figure that does not exist."""
        figures = {
            name: value if math.isfinite(value) else None
            for name, value in self.windows._asdict().items()
        }
        return {"verdict": str(self.verdict), "windows": {"window_s": self.window_s, **figures}}


def samples_judged(rules: VerdictRules, duration_s: float, period_s: float) -> int:
    """Return how many of its last samples the verdict on a run needs."""
    window = round(min(rules.window_s, WINDOW_SHARE_MAX * duration_s) / period_s)
    return 2 * (window + fast_half(window, period_s))


def judge(
    rules: VerdictRules,
    error_m: Sequence[float],
    wheel_rad: Sequence[float],
    end: RunEnd,
    noise_m: float,
    peaks_m: Peaks,
    period_s: float,
    samples: int,
) -> JudgedRun:
    """Return the verdict on one run.

    ``error_m``    of the judged point, its last samples: all, or as many as ``samples_judged``
    ``wheel_rad``  as many
    ``end``        how it ended, if it was long enough
    ``noise_m``    standard deviation of the sensor's noise on the lateral error
    ``period_s``   between two samples
    ``samples``    how many it had in all
    """
    window = min(round(rules.window_s / period_s), int(samples * WINDOW_SHARE_MAX))
    windows = window_figures(error_m, wheel_rad, window, period_s)
    ends = np.array([RUN_ENDS.index(end_of(end, samples * period_s))])
    at = np.array([noise_m]), np.array([peaks_m]), np.array([windows])
    verdict = verdicts(rules, ends, *at)[0]
    return JudgedRun(verdict, window * period_s, windows)
