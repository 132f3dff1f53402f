"""The predictor in compiled runs, with limits, quantisation and counters: the judge of a design.

Every vehicle that the specification takes from the box is driven along every path.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import NamedTuple

import numpy as np

from ...closed_loop.compiled.engine import Outcome, run_batch
from ...closed_loop.compiled.schedule import RunSchedule, schedule_run
from ...controller.analysis.loop_signals import LoopModel
from ...controller.analysis.predictor_loop import PredictorLoop, linear
from ...controller.filters.nominal_model import NominalVehicle
from ...controller.laws.assembly import design_law
from ...controller.settings import ControllerSettings
from ...plant_emulator.network.latency_distributions import Distribution
from ...plant_emulator.network.settings import LatencySettings
from ...plant_emulator.sensors.settings import SensorNoiseSettings
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_MS
from .specification import ConditionsTable, PredictorTable, Specification
from .vehicle_file import VehicleFile
from .virtual_check import Drive, constant, plant_settings

LEFT_M = 1e3
"""Error of a run that leaves the range of the sensor [m]."""
_QUIET = SensorNoiseSettings()


class Task(NamedTuple):
    """What is designed, and the threads for its runs."""

    pool: ThreadPoolExecutor
    spec: Specification
    table: PredictorTable
    vehicle: VehicleFile

    @property
    def vehicles(self) -> tuple[NominalVehicle, ...]:
        """The vehicles that are judged."""
        return self.vehicle.box.grid(self.table.values_per_range)


class Run(NamedTuple):
    """Lateral error of a run: RMS, RMS without the first seconds, largest; and its commands."""

    rms_m: float
    settled_rms_m: float
    largest_m: float
    sent_rad: FloatArray


def runs(
    task: Task,
    settings: ControllerSettings,
    latencies: Sequence[LatencySettings],
    noise: SensorNoiseSettings = _QUIET,
    lag_s: float = 0.0,
    seed: int = 1,
) -> list[list[Run]]:
    """Return the runs of each latency: every path and vehicle."""
    course = task.spec.course

    def of_latency(latency: LatencySettings) -> list[Run]:
        plants = [
            plant_settings(
                Drive(settings, vehicle, path, course.duration_s, latency, lag_s, seed)
            ).model_copy(update={"sensor_noise": noise})
            for path, vehicle in product(course.paths, task.vehicles)
        ]
        plan = schedule_run(plants[0], settings)
        return list(
            task.pool.map(lambda plant: _run(plant, settings, plan, task.table.ignore_s), plants)
        )

    return [of_latency(latency) for latency in latencies]


def _run(
    plant: PlantSettings, settings: ControllerSettings, plan: RunSchedule, ignore_s: float
) -> Run:
    run = run_batch(plant, settings, plan)
    if run.outcome is not Outcome.COMPLETE:
        return Run(LEFT_M, LEFT_M, LEFT_M, run.sent_rad)
    squares = np.square(run.lateral_error_m)
    return Run(
        float(np.sqrt(squares.mean())),
        float(np.sqrt(squares[run.time_s >= ignore_s].mean())),
        float(np.sqrt(squares.max())),
        run.sent_rad,
    )


def largest_error_m(task: Task, settings: ControllerSettings, met: ConditionsTable) -> float:
    """Return the largest lateral error of any run with these conditions."""
    random = met.spread_ms > 0.0
    latency = LatencySettings(
        model=Distribution.GAMMA if random else Distribution.CONSTANT,
        mean_s=1e-3 * met.mean_ms,
        spread_s=1e-3 * met.spread_ms,
        correlation_time_s=1e-3 * met.correlation_ms,
        loss=met.loss,
        burst_frames=met.burst_frames,
        order=met.order,
    )
    seeds = range(1, task.table.seeds + 1 if random or met.loss > 0.0 else 2)
    done = (
        runs(task, settings, [latency], lag_s=1e-3 * met.lag_ms, seed=seed)[0] for seed in seeds
    )
    return max(run.largest_m for of_seed in done for run in of_seed)


def steer_noise_rad(task: Task, settings: ControllerSettings, without: Sequence[Run]) -> float:
    """Return the standard deviation of the steer with noise less that without, the worst run's.

    ``without``  the runs without noise, at the longest delay
    """
    spec, table = task.spec, task.table
    noise = SensorNoiseSettings(lateral_error_m=table.lateral_error_noise_m)
    with_noise = runs(task, settings, [constant(table.delays_ns[-1])], noise)[0]
    first = round(table.ignore_s * 1e3 * NS_PER_MS / spec.period_ns)
    return max(
        float(np.std(noisy.sent_rad[first:] - clean.sent_rad[first:]))
        if len(noisy.sent_rad) == len(clean.sent_rad)
        else math.inf
        for noisy, clean in zip(with_noise, without, strict=True)
    )


def peak_sensitivity(task: Task, settings: ControllerSettings, delays_ns: Sequence[int]) -> float:
    """Return the largest peak sensitivity over all vehicles; infinite where one is not stable."""
    design, loop_delay = (
        design_law(linear(settings)),
        settings.loop_delay,
    )
    loops = [PredictorLoop(design, loop_delay, LoopModel(vehicle)) for vehicle in task.vehicles]
    return max(
        loop.peak_sensitivity(delay_ns) if loop.is_stable(delay_ns) else math.inf
        for loop, delay_ns in product(loops, delays_ns)
    )
