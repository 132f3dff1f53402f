"""Run that shows what sensor noise does to a design of the frontier.

It has the real limits on the commands, frames, and the steering's guard as it is by default. It is
compiled, which gives the numbers of the nodes in virtual time.
"""

import math

from ....closed_loop.compiled.engine import rms_of, run_compiled
from ....closed_loop.studies.compiled_runs import verdict_on
from ....controller.analysis.loop_signals import HEADING_NOISE_1_M
from ....controller.settings import ControllerSettings
from ....plant_emulator.evaluation.run_verdict import Verdict
from ....plant_emulator.network.settings import LatencySettings
from ....plant_emulator.sensors.settings import SensorNoiseSettings
from ..virtual_check import plant_settings
from .settings import Panel

SENSOR_NOISE_M = 0.02
"""Standard deviation of white noise on the lateral error."""


def noisy_rms_m(panel: Panel, settings: ControllerSettings, delay_ms: float) -> float:
    """Return the car's RMS, of the nominal vehicle at this delay, with sensor noise.

    Infinite where the run does not hold.
    """
    noise = SensorNoiseSettings(
        lateral_error_m=SENSOR_NOISE_M, heading_error_rad=HEADING_NOISE_1_M * SENSOR_NOISE_M
    )
    plant = plant_settings(
        settings.period_ns, panel.vehicle.vehicle.vehicle, panel.table.course.paths[0],
        panel.table.course.duration_s, LatencySettings(mean_s=delay_ms / 1e3), seed=1001,
        sensor_noise=noise,
    )  # fmt: skip
    run = run_compiled(plant, settings)
    if verdict_on(plant, settings, run) is not Verdict.HOLDS:
        return math.inf
    return rms_of(run.cg_deviation_m[run.time_s >= panel.asked.ignore_s])
