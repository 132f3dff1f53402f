"""Trials of a design: noise, side wind, a wheel offset, a wrong vehicle and jitter.

Each run has the real limits on the commands, frames, and the steering's guard as it is by default.
The runs are compiled, which gives the numbers of the nodes in virtual time.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ....closed_loop.compiled.engine import run_compiled
from ....closed_loop.studies.compiled_runs import verdict_on
from ....controller.filters.nominal_model import NominalVehicle
from ....controller.laws.feed_forward import FeedForwardSettings
from ....controller.settings import ControllerSettings
from ....plant_emulator.evaluation.run_verdict import Verdict
from ....plant_emulator.network.latency_distributions import Distribution
from ....plant_emulator.network.settings import LatencySettings
from ....plant_emulator.path.settings import PathSettings, StraightSettings
from ....plant_emulator.sensors.settings import SensorNoiseSettings
from ....plant_emulator.vehicle.settings import DisturbanceSettings, DisturbanceStep
from ..loop_figures import HEADING_NOISE_1_M
from ..vehicle_file import VehicleFile
from ..virtual_check import plant_settings
from .settings import FrontierSettings

SENSOR_NOISE_M = 0.02
"""Standard deviation of white noise on the lateral error."""
SIDE_FORCE_N = 1000.0
STEERING_OFFSET_RAD = 0.02
"""Of the wheel behind its sensor, on a straight as the side force."""
LAG_S = 0.1
"""Of the steering, which the design does not know."""
JITTER_SHARE = 0.3
"""Spread of the latency over its mean, which is the guaranteed delay over 1 + margin_share."""
SEEDS = range(1001, 1101)
"""Of the jitter: no design has used them."""
_AT_S = 5.0
"""When the side wind and the wheel offset begin."""
_LAST_S = 10.0
"""At the end of a run: what is left of an offset."""
_WRONG_FRONT_STIFFNESS = 0.7
"""Of the nominal front cornering stiffness; outside the box."""


class Trials(NamedTuple):
    """Results at the delay that a design guarantees; infinite where the run does not hold.

    ``noisy_rms_m``     nominal vehicle, sensor noise
    ``wind_peak_m``     peak on a straight after the step of the side force
    ``offset_left_m``   mean error at the end, after a step of the wheel's offset
    ``wrong_rms_m``     heaviest and fastest corner, its front tyres softer by 30 %
    ``jitter_median_m``, ``jitter_95_m``  RMS over the seeds
    ``jitter_lost``     how many of the seeds do not hold
    """

    noisy_rms_m: float
    wind_peak_m: float
    offset_left_m: float
    wrong_rms_m: float
    jitter_median_m: float
    jitter_95_m: float
    jitter_lost: int


NOT_TRIED = Trials(math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, 0)


def try_out(
    asked: FrontierSettings, vehicle: VehicleFile, settings: ControllerSettings, delay_ms: float
) -> Trials:
    """Run a design at its delay."""
    nominal, ellipse = vehicle.vehicle.vehicle, asked.course.paths[0]
    constant = LatencySettings(mean_s=delay_ms / 1e3)

    def run(**tables: Any) -> "_Errors":
        given = {"vehicle": nominal, "path": ellipse, "line": constant} | tables
        return _run(asked, settings, **given)

    def after_step(**values: float) -> "_Errors":
        steps = (DisturbanceStep(at_s=_AT_S, **values),)
        straight = StraightSettings(kind="straight")
        return run(path=straight, disturbance=DisturbanceSettings(steps=steps))

    noise = SensorNoiseSettings(
        lateral_error_m=SENSOR_NOISE_M, heading_error_rad=HEADING_NOISE_1_M * SENSOR_NOISE_M
    )
    wrong = vehicle.box.vertices()[-1]
    wrong = wrong._replace(
        front_cornering_stiffness_n_rad=_WRONG_FRONT_STIFFNESS
        * wrong.front_cornering_stiffness_n_rad
    )
    mean_s = delay_ms / 1e3 / (1.0 + asked.margin_share)
    jitter = LatencySettings(
        model=Distribution.GAMMA, mean_s=mean_s, spread_s=JITTER_SHARE * mean_s
    )
    rms_m = np.array([run(line=jitter, seed=seed).rms_m for seed in SEEDS])
    return Trials(
        run(sensor_noise=noise).rms_m,
        after_step(side_force_n=SIDE_FORCE_N).peak_m,
        after_step(steering_offset_rad=STEERING_OFFSET_RAD).left_m,
        run(vehicle=wrong).rms_m,
        float(np.quantile(rms_m, 0.5, method="higher")),
        float(np.quantile(rms_m, 0.95, method="higher")),
        int(np.count_nonzero(~np.isfinite(rms_m))),
    )


def with_map(settings: ControllerSettings, takes_map: bool) -> ControllerSettings:
    """Return a design with the steer for the map's curvature, if it takes that."""
    if not takes_map:
        return settings
    return settings.model_copy(update={"feed_forward": FeedForwardSettings()})


def worst_rms_m(
    asked: FrontierSettings, vehicle: VehicleFile, settings: ControllerSettings, delay_ms: float
) -> float:
    """Return the RMS of the worst corner at no delay and at this one, without noise."""
    return max(
        _run(asked, settings, corner, asked.course.paths[0], LatencySettings(mean_s=s)).rms_m
        for corner in vehicle.box.vertices()
        for s in (0.0, delay_ms / 1e3)
    )


class _Errors(NamedTuple):
    rms_m: float
    peak_m: float
    left_m: float


_LOST = _Errors(math.inf, math.inf, math.inf)


def _run(
    asked: FrontierSettings,
    settings: ControllerSettings,
    vehicle: NominalVehicle,
    path: PathSettings,
    line: LatencySettings,
    **tables: Any,
) -> _Errors:
    duration_s, tables = asked.course.duration_s, {"seed": SEEDS[0], **tables}
    plant = plant_settings(settings.period_ns, vehicle, path, duration_s, line, **tables)
    run = run_compiled(plant, settings)
    if verdict_on(plant, settings, run) is not Verdict.HOLDS:
        return _LOST
    counts = run.lateral_error_m[run.time_s >= asked.ignore_s]
    last = run.lateral_error_m[run.time_s >= duration_s - _LAST_S]
    peak_m = float(np.abs(counts).max())
    return _Errors(float(np.sqrt(np.mean(np.square(counts)))), peak_m, abs(float(last.mean())))
