"""Designs the predictor: the noise that its filter assumes, and the weight in its feedback's cost.

The gains of filter and feedback follow from these for every speed. The law itself is judged in
compiled runs, with limits, quantisation and counters: for every path, corner and delay the RMS of
the lateral error once it has settled, and how much of the sensors' noise reaches the steer. The
evolution strategy is the same as for the other laws.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from ...compiled.engine import Outcome, run_batch
from ...controller.analysis.sampled_loop import SampledLoop
from ...controller.analysis.stable_delays import DELAY_NS_MAX, delay_margin_ns, stable_delays
from ...controller.design import design_law
from ...controller.laws.predictor import FALLBACK, PredictorSettings
from ...controller.nominal_model import steer_to_lateral_error
from ...controller.settings import ControllerSettings
from ...controller.shared_settings import EstimatorSettings
from ...plant_emulator.latency_settings import LatencySettings
from ...plant_emulator.rig_settings import SensorNoiseSettings
from ...plant_emulator.settings import PlantSettings
from ...runtime.node import NS_PER_MS
from .evolution import evolve
from .specification import PredictorTable, Specification
from .vehicle_file import VehicleFile
from .virtual_check import Drive, jittered, plant_settings

FloatArray = NDArray[np.float64]

_THREADS = 2
_START = {
    "steer_per_error_rad_m": 1.0,
    "steering_offset_walk_rad_sqrt_s": 0.002,
    "curvature_walk_1_m_sqrt_s": 0.02,
    "yaw_rate_noise_rad_s_sqrt_s": 0.05,
}
"""What is searched, in logarithms, and from where."""
_DECADE = math.log(10.0)
_LEFT_M = 1e3
"""Cost of a run that leaves the range of the sensor [m]."""
_DIGITS = 2


class PredictorDesign(NamedTuple):
    """A predictor, and its figures.

    ``rms_m``            worst path and corner at each of ``delays_ns``, from the start
    ``settled_rms_m``    the same without the first seconds
    ``steer_noise_rad``  standard deviation of what the noise adds to the steer
    ``jitter_rms_m``     worst path and corner of each jitter of the specification, settled
    ``fallback_up_to_ns``  constant delay up to which every corner is stable with the pd_ddob that
                         takes over without echoes; at most DELAY_NS_MAX of the analysis
    """

    settings: ControllerSettings
    judged: int
    delays_ns: tuple[int, ...]
    rms_m: FloatArray
    settled_rms_m: FloatArray
    steer_noise_rad: float
    jitter_rms_m: tuple[float, ...]
    fallback_up_to_ns: int


class _Run(NamedTuple):
    rms_m: float
    settled_rms_m: float
    sent_rad: FloatArray


def design_predictor(
    spec: Specification,
    table: PredictorTable,
    vehicle: VehicleFile,
    fallback: ControllerSettings,
    progress: Callable[[float, float], None],
) -> PredictorDesign:
    """Return the best predictor by the specification; ``fallback`` is the pd_ddob it falls back to.

    ``progress``  called with the share of the search that is done, and its best cost [m]
    """
    start = np.array([math.log(value) for value in _START.values()])
    random = np.random.default_rng(spec.search.seed)
    points = spec.search.points_per_parameter * len(start)
    best, judged = start, 0
    with ThreadPoolExecutor(_THREADS) as pool:

        def cost(values: FloatArray) -> float:
            try:
                settings = _settings(table, vehicle, fallback, values)
            except ValidationError:
                return _LEFT_M
            return _cost(pool, spec, table, vehicle, settings)

        for generation in evolve(cost, start, np.full(len(start), 0.3 * _DECADE), points, random):
            best, judged = generation.best, generation.judged
            progress(generation.number / table.generations, generation.best_cost)
            if generation.number >= table.generations:
                break
        settings = _settings(table, vehicle, fallback, best)
        return describe_predictor(pool, spec, table, vehicle, settings)._replace(judged=judged)


def describe_predictor(
    pool: ThreadPoolExecutor,
    spec: Specification,
    table: PredictorTable,
    vehicle: VehicleFile,
    settings: ControllerSettings,
) -> PredictorDesign:
    """Return the figures of a predictor."""
    latencies = [_constant(delay_ns) for delay_ns in table.delays_ns]
    runs = _runs(pool, spec, table, vehicle, settings, latencies)
    jitters = _runs(pool, spec, table, vehicle, settings, [jittered(one) for one in spec.jitter])
    return PredictorDesign(
        settings,
        0,
        table.delays_ns,
        np.array([max(run.rms_m for run in column) for column in runs]),
        np.array([max(run.settled_rms_m for run in column) for column in runs]),
        _steer_noise_rad(pool, spec, table, vehicle, settings, runs[-1]),
        tuple(max(run.settled_rms_m for run in column) for column in jitters),
        _fallback_up_to_ns(vehicle, settings),
    )


def _fallback_up_to_ns(vehicle: VehicleFile, settings: ControllerSettings) -> int:
    """Return up to which constant delay the pd_ddob is stable at every corner."""
    design = design_law(settings.model_copy(update={"law": FALLBACK}))
    margins = (
        delay_margin_ns(
            stable_delays(SampledLoop(design, steer_to_lateral_error(one), settings.period_ns))
        )
        for one in vehicle.box.vertices()
    )
    return min(DELAY_NS_MAX if margin is None else margin for margin in margins)


def _cost(
    pool: ThreadPoolExecutor,
    spec: Specification,
    table: PredictorTable,
    vehicle: VehicleFile,
    settings: ControllerSettings,
) -> float:
    """Return the worst RMS at both ends of the delays and half-way; more for too much noise."""
    ends = (0, table.delays_ns[-1] // 2, table.delays_ns[-1])
    runs = _runs(pool, spec, table, vehicle, settings, [_constant(delay) for delay in ends])
    worst_m = max(run.settled_rms_m for column in runs for run in column)
    noise_rad = _steer_noise_rad(pool, spec, table, vehicle, settings, runs[-1])
    excess = noise_rad / table.steer_noise_rad_max
    return worst_m if excess <= 1.0 else _LEFT_M * excess


def _settings(
    table: PredictorTable,
    vehicle: VehicleFile,
    fallback: ControllerSettings,
    logarithms: FloatArray,
) -> ControllerSettings:
    """Return the settings of a point of the search, in numbers of two digits."""
    values = {
        key: float(f"{math.exp(value):.{_DIGITS}g}")
        for key, value in zip(_START, logarithms, strict=True)
    }
    box = {name: (low, high) for name, low, high in vehicle.box.ranges}
    speed = vehicle.vehicle.speed_m_s
    low, high = box.get("speed_m_s", (speed, speed))
    tables = fallback.model_dump(exclude={"law", "estimator"})
    tables["predictor"] = PredictorSettings(
        steer_per_error_rad_m=values.pop("steer_per_error_rad_m"),
        horizon_s_max=table.horizon_s_max,
    )
    return ControllerSettings(
        **tables,
        law="predictor",
        estimator=EstimatorSettings(
            lateral_error_noise_m=table.lateral_error_noise_m,
            heading_error_noise_rad=table.heading_error_noise_rad,
            speed_m_s_min=round(0.5 * low, 2),
            speed_m_s_max=round(1.5 * high, 2),
            **values,
        ),
    )


def _constant(delay_ns: int) -> LatencySettings:
    return LatencySettings(mean_s=delay_ns * 1e-9)


def _runs(
    pool: ThreadPoolExecutor,
    spec: Specification,
    table: PredictorTable,
    vehicle: VehicleFile,
    settings: ControllerSettings,
    latencies: Sequence[LatencySettings],
    noise: SensorNoiseSettings | None = None,
) -> list[list[_Run]]:
    """Return the runs of each latency: every path and corner."""
    cells = [
        Drive(settings, corner, path, spec.course.duration_s, latency)
        for latency, path, corner in product(latencies, spec.course.paths, vehicle.box.vertices())
    ]
    quiet = SensorNoiseSettings() if noise is None else noise
    plants = [plant_settings(cell).model_copy(update={"sensor_noise": quiet}) for cell in cells]
    done = list(pool.map(lambda plant: _run(plant, settings, table.ignore_s), plants))
    count = len(done) // max(1, len(latencies))
    return [done[first : first + count] for first in range(0, len(done), max(1, count))]


def _run(plant: PlantSettings, settings: ControllerSettings, ignore_s: float) -> _Run:
    run = run_batch(plant, settings)
    if run.outcome is not Outcome.COMPLETE:
        return _Run(_LEFT_M, _LEFT_M, run.sent_rad)
    squares = np.square(run.lateral_error_m)
    return _Run(
        float(np.sqrt(squares.mean())),
        float(np.sqrt(squares[run.time_s >= ignore_s].mean())),
        run.sent_rad,
    )


def _steer_noise_rad(
    pool: ThreadPoolExecutor,
    spec: Specification,
    table: PredictorTable,
    vehicle: VehicleFile,
    settings: ControllerSettings,
    without: Sequence[_Run],
) -> float:
    """Return the standard deviation of the steer with noise less that without, the worst run's.

    ``without``  the runs without noise, at the longest delay
    """
    noise = SensorNoiseSettings(lateral_error_m=table.lateral_error_noise_m)
    longest = [_constant(table.delays_ns[-1])]
    with_noise = _runs(pool, spec, table, vehicle, settings, longest, noise)[0]
    first = round(table.ignore_s * 1e3 * NS_PER_MS / spec.period_ns)
    return max(
        float(np.std(noisy.sent_rad[first:] - clean.sent_rad[first:]))
        if len(noisy.sent_rad) == len(clean.sent_rad)
        else math.inf
        for noisy, clean in zip(with_noise, without, strict=True)
    )
