"""Runs that confirm a design of the frontier: without noise at the corners, and with sensor noise.

Each run has the real limits on the commands, frames, and the steering's guard as it is by default.
The runs are compiled, which gives the numbers of the nodes in virtual time.
"""

import math
from typing import Any

import numpy as np

from ....closed_loop.compiled.engine import run_compiled
from ....closed_loop.studies.compiled_runs import verdict_on
from ....controller.filters.nominal_model import NominalVehicle
from ....controller.settings import ControllerSettings
from ....plant_emulator.evaluation.run_verdict import Verdict
from ....plant_emulator.network.settings import LatencySettings
from ....plant_emulator.sensors.settings import SensorNoiseSettings
from ..loop_figures import HEADING_NOISE_1_M
from ..vehicle_file import VehicleFile
from ..virtual_check import plant_settings
from .settings import FrontierSettings

SENSOR_NOISE_M = 0.02
"""Standard deviation of white noise on the lateral error."""


def worst_rms_m(
    asked: FrontierSettings, vehicle: VehicleFile, settings: ControllerSettings, delay_ms: float
) -> float:
    """Return the RMS of the worst corner at no delay and at this one, without noise."""
    return max(
        _rms_m(asked, settings, corner, delay_s)
        for corner in vehicle.box.vertices()
        for delay_s in (0.0, delay_ms / 1e3)
    )


def noisy_rms_m(
    asked: FrontierSettings, vehicle: VehicleFile, settings: ControllerSettings, delay_ms: float
) -> float:
    """Return the RMS of the nominal vehicle at this delay, with sensor noise."""
    noise = SensorNoiseSettings(
        lateral_error_m=SENSOR_NOISE_M, heading_error_rad=HEADING_NOISE_1_M * SENSOR_NOISE_M
    )
    nominal = vehicle.vehicle.vehicle
    return _rms_m(asked, settings, nominal, delay_ms / 1e3, sensor_noise=noise)


def _rms_m(
    asked: FrontierSettings,
    settings: ControllerSettings,
    vehicle: NominalVehicle,
    delay_s: float,
    **tables: Any,
) -> float:
    """Return the RMS on the first path; infinite where the run does not hold."""
    plant = plant_settings(
        settings.period_ns, vehicle, asked.course.paths[0], asked.course.duration_s,
        LatencySettings(mean_s=delay_s), seed=1001, **tables,
    )  # fmt: skip
    run = run_compiled(plant, settings)
    if verdict_on(plant, settings, run) is not Verdict.HOLDS:
        return math.inf
    counts = run.lateral_error_m[run.time_s >= asked.ignore_s]
    return float(np.sqrt(np.mean(np.square(counts))))
