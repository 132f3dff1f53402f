"""Design of the predictor: the noise its filter assumes, and the weight in its feedback's cost.

The gains of filter and feedback follow from these for every speed. Minimised is the RMS of the
car's deviation once it has settled, the worst of every path, vehicle and delay; on a road, the
largest deviation. Limited are the peak sensitivity, how much of the noise of all sensors reaches
the steer, and the largest deviation under each of the specification's conditions. The runs are
compiled, with limits, quantisation and counters. The search is that of the other laws.

Where the specification gives a margin of lag, the lag that the law believes in is searched too, and
the loop has to meet its limits with the vehicle's own lag and with the believed one, which is the
one that ``check`` assumes.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain, product
from typing import NamedTuple

import numpy as np

from ...closed_loop.compiled.schedule import schedule_run
from ...controller.analysis.loop_signals import LoopModel
from ...controller.analysis.periodic_loop import PeriodicLoop, Responses, linear
from ...controller.analysis.sampled_loop import SampledLoop
from ...controller.analysis.stable_delays import least_margin_ns
from ...controller.filters.nominal_model import NominalVehicle
from ...controller.filters.settings import VehicleModelSettings
from ...controller.history.echo_delay import LinkSettings
from ...controller.laws.law_from_settings import design_law, required
from ...controller.laws.packet import PacketSettings
from ...controller.laws.predictor import FALLBACK, PredictorSettings
from ...controller.prediction.gains_over_speed import EstimatorSettings
from ...controller.settings import ControllerSettings
from ...plant_emulator.network.latency_distributions import Distribution
from ...plant_emulator.network.settings import LatencySettings
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.vehicle.settings import ActuatorSettings
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_MS, NS_PER_S
from ...runtime.settings import SettingsError
from .demands import Demand
from .loop_figures import LoopFigures
from .road import lag_of, road_plants, roads_in_words
from .search.evolution import Search, Values
from .search.law_parameters import validity, with_set_point
from .specification import ConditionsTable, PredictorTable, Specification
from .vehicle_file import VehicleFile
from .virtual_check import LEFT_M, Driven, constant, drive, jittered, plant_settings

RMS_M_MAX = 1.0
"""Largest RMS of a predictor that keeps to the path, at any delay of the range [m]."""
_THREADS = 2
START = {
    "steer_per_error_rad_m": 1.0,
    "steering_offset_walk_rad_sqrt_s": 0.002,
    "curvature_walk_1_m_sqrt_s": 0.02,
    "yaw_rate_noise_rad_s_sqrt_s": 0.05,
}
"""What is searched, and where it starts."""
START_WITH_YAW_RATE = {
    "steer_per_error_rad_m": 0.3,
    "steering_offset_walk_rad_sqrt_s": 0.0005,
    "curvature_walk_1_m_sqrt_s": 0.008,
    "yaw_rate_noise_rad_s_sqrt_s": 0.03,
    "side_slip_noise_rad_sqrt_s": 0.0005,
    "yaw_rate_sensor_noise_rad_s": 0.002,
}
"""Start where the law reads the yaw rate."""
START_WITH_PATH = {
    "steer_per_error_rad_m": 0.45,
    "steering_offset_walk_rad_sqrt_s": 0.0001,
    "curvature_walk_1_m_sqrt_s": 0.0015,
    "yaw_rate_noise_rad_s_sqrt_s": 0.02,
    "side_slip_noise_rad_sqrt_s": 0.0007,
    "yaw_rate_sensor_noise_rad_s": 0.0008,
}
"""Start where the path is known, too: a filter that believes its model."""
_CURVATURE_AVERAGING_S = 0.05
"""Mean of the rate of VEHICLE_STATE's curvature; chosen."""
_RANGE, _RANGE_WITH_YAW_RATE = 30.0, 6.0
"""Factor by which the search may leave the start."""
_SPREAD = 0.1
"""Standard deviation of the first generation, as a share of the range: 0.3 decades."""
_DIGITS = 2
_FAR = 1.5
"""Times the least cost."""


class Task(NamedTuple):
    """What is designed, and the threads for its runs."""

    pool: ThreadPoolExecutor
    spec: Specification
    vehicle: VehicleFile

    @property
    def table(self) -> PredictorTable:
        """What is demanded of a predictor."""
        return required(self.spec.predictor)

    @property
    def vehicles(self) -> tuple[NominalVehicle, ...]:
        """The vehicles that are judged."""
        nominal, points = self.vehicle.vehicle.vehicle, self.table.values_per_range
        return self.vehicle.uncertainty.corners(nominal, points)

    @property
    def knows_path(self) -> bool:
        """Whether the path's curvature comes over the bus."""
        return self.spec.road is not None and self.spec.road.path_known

    @property
    def steering_s(self) -> tuple[float, float]:
        """The dead time of the steering, in whole periods, and what is left of it with the lag."""
        if self.spec.road is None:
            return 0.0, 0.0
        steering = self.plants(LatencySettings(), 0.0, 1)[0].actuator
        rest_ns = steering.dead_time_ns % self.spec.period_ns
        dead_s = (steering.dead_time_ns - rest_ns) / NS_PER_S
        return dead_s, steering.lag_s + rest_ns / NS_PER_S

    @property
    def loop_models(self) -> list[LoopModel]:
        """The vehicles of the linear figures, with the lag that they have besides a dead time."""
        if self.spec.road is None:
            return [LoopModel(vehicle) for vehicle in self.vehicles]
        plants, (dead_s, _) = self.plants(LatencySettings(), 0.0, 1), self.steering_s
        return [
            LoopModel(
                NominalVehicle(**each.model_dump(include=set(NominalVehicle._fields))),
                max(lag_s - dead_s, 0.0),
            )
            for each, lag_s in dict.fromkeys((plant.vehicle, lag_of(plant)) for plant in plants)
        ]

    def plants(self, latency: LatencySettings, lag_s: float, seed: int) -> list[PlantSettings]:
        """Return the plant of every path and vehicle, behind more lag than they have."""
        spec = self.spec
        if spec.road is not None:
            duration_s = spec.course.duration_s
            return road_plants(spec.road, self.vehicle, latency, duration_s, lag_s, seed)
        return [
            plant_settings(
                spec.period_ns, vehicle, path, spec.course.duration_s, latency,
                seed=seed, actuator=ActuatorSettings(lag_s=lag_s),
            )
            for path, vehicle in product(spec.course.paths, self.vehicles)
        ]  # fmt: skip


def runs(
    task: Task,
    settings: ControllerSettings,
    latency: LatencySettings,
    lag_s: float = 0.0,
    seed: int = 1,
) -> list[Driven]:
    """Return the run of every path and vehicle with a latency of the commands."""
    plants = task.plants(latency, lag_s, seed)
    plan = schedule_run(plants[0], settings)
    return list(task.pool.map(lambda plant: drive(task.spec, plant, settings, plan), plants))


def worst_m(done: Iterable[Driven], figure: str = "rms_m") -> float:
    """Return the largest of a figure of runs [m]."""
    return float(max(getattr(run, figure) for run in done))


def largest_error_m(task: Task, settings: ControllerSettings, met: ConditionsTable) -> float:
    """Return the car's largest deviation in any run with these conditions."""
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
    lag_s = 1e-3 * met.lag_ms
    return max(worst_m(runs(task, settings, latency, lag_s, seed), "largest_m") for seed in seeds)


def road_errors_m(task: Task, settings: ControllerSettings, delay_ns: int) -> tuple[float, float]:
    """Return the largest deviation of the car, and that of the heavier and softer one."""
    seeds = range(1, task.table.seeds + 1)
    found = [runs(task, settings, constant(delay_ns), seed=seed) for seed in seeds]
    half = len(found[0]) // 2
    known, other = (
        worst_m(chain.from_iterable(each[part] for each in found), "largest_m")
        for part in (slice(None, half), slice(half, None))
    )
    return known, other


def linear_figures(
    task: Task, settings: ControllerSettings, delays_ns: Sequence[int]
) -> LoopFigures:
    """Return the figures of the loop; it has to be stable beyond the range by the margin too."""
    design, loop_delay = design_law(linear(settings)), settings.loop_delay
    responses: Responses = {}  # the law's own, at each speed
    believed_s = settings.estimator.actuator_lag_s
    own = task.loop_models
    models = [*own, *(model._replace(actuator_lag_s=believed_s) for model in own)]
    loops = [
        PeriodicLoop(design, loop_delay, model, responses=responses)
        for model in dict.fromkeys(models)
    ]
    beyond_ns = task.table.delays_ns[-1] + round(task.table.margin_ms * NS_PER_MS)
    if not all(loop.is_stable(each) for loop in loops for each in (*delays_ns, beyond_ns)):
        return LoopFigures(math.inf, math.inf)
    places = list(product(loops, delays_ns))
    return LoopFigures(
        max(loop.peak_sensitivity(delay_ns) for loop, delay_ns in places),
        max(loop.noise_gain_rad_m(delay_ns) for loop, delay_ns in places),
    )


class PredictorDesign(NamedTuple):
    """A predictor, and its figures.

    ``rms_m``            worst path and vehicle at each of ``delays_ns``, from the start
    ``settled_rms_m``    ``rms_m`` without the first seconds
    ``linear``           worst vehicle and delay
    ``jitter_rms_m``     worst path and vehicle of each jitter of the specification, settled
    ``conditions_m``     largest error under each of the specification's conditions
    ``road_m``           on a road, ``road_errors_m`` at each of ``delays_ns``; else empty
    ``without_path_m``   ``road_m`` where PATH_AHEAD does not come, of a design that knows the path
    ``fallback_up_to_ns``  constant delay up to which every corner is stable with the pd_ddob that
                         takes over without echoes; at most DELAY_NS_MAX of the analysis
    ``ended``            whether the search came to its end; otherwise this is its best so far
    """

    settings: ControllerSettings
    values: Values
    judged: int
    delays_ns: tuple[int, ...]
    rms_m: FloatArray
    settled_rms_m: FloatArray
    peak_sensitivity: float
    noise_gain_rad_m: float
    jitter_rms_m: tuple[float, ...]
    conditions_m: tuple[float, ...]
    fallback_up_to_ns: int
    road_m: FloatArray
    without_path_m: FloatArray
    ended: bool = True


def predictor_demands(spec: Specification, design: PredictorDesign) -> tuple[Demand, ...]:
    """Return what is demanded of a predictor and what it reached.

    The conditions are named by their number, as they stand in the specification.
    """
    road = spec.road
    if road is None:
        errors = [Demand("RMS error", float(design.rms_m.max()), RMS_M_MAX)]
    else:
        known_m, other_m = design.road_m.max(axis=0).tolist()
        errors = [
            Demand("largest error", known_m, road.error_m_max),
            Demand("heavy and soft", other_m, road.off_error_m_max),
        ]
    return (
        *errors,
        Demand("peak sensitivity", design.peak_sensitivity, spec.peak_sensitivity_max),
        Demand("noise gain", design.noise_gain_rad_m, spec.noise_gain_rad_m_max),
        *(
            Demand(f"condition {number}", largest_m, met.error_m_max)
            for number, (met, largest_m) in enumerate(
                zip(required(spec.predictor).conditions, design.conditions_m, strict=True), start=1
            )
        ),
    )


def design_predictor(
    spec: Specification,
    vehicle: VehicleFile,
    fallback: ControllerSettings,
    until_s: float,
    near: Sequence[Values] = (),
) -> PredictorDesign:
    """Return the best predictor by the specification, which falls back to ``fallback``.

    ``until_s``  of the monotonic clock: then the best so far is taken
    ``near``     known designs, near each of which a start begins, before one in the middle of the
                 ranges
    """
    with ThreadPoolExecutor(_THREADS) as pool:
        task = Task(pool, spec, vehicle)
        ranges, middle = _ranges(task)

        def cost(values: Values) -> float:
            try:
                return _cost(task, _settings(task, fallback, values), search.least)
            except SettingsError:
                return LEFT_M * LEFT_M

        search = Search(cost, ranges, until_s, _DIGITS)
        for start, place in enumerate((*near, middle)):
            search.evolve(spec.search.seed + start, task.table.generations, place, _SPREAD)
        (best,) = search.best(1)
        design = describe_predictor(task, _settings(task, fallback, best))
        return design._replace(judged=search.judged, ended=search.ended, values=best)


def _ranges(task: Task) -> tuple[dict[str, tuple[float, float]], Values]:
    """Return between which values each parameter is searched, and where the search starts."""
    table = task.table
    start, factor = dict(START), _RANGE
    if table.reads_yaw_rate:
        factor = _RANGE_WITH_YAW_RATE
        start = dict(START_WITH_PATH if task.knows_path else START_WITH_YAW_RATE)
    ranges = {key: (value / factor, value * factor) for key, value in start.items()}
    if table.lag_margin_ms is not None:
        _, own_s = task.steering_s
        low_s, high_s = (own_s + 1e-3 * margin_ms for margin_ms in table.lag_margin_ms)
        ranges["actuator_lag_s"] = low_s, high_s
        start["actuator_lag_s"] = math.sqrt(low_s * high_s)
    return ranges, start


def plan_ahead(
    spec: Specification, vehicle: VehicleFile, predictor: ControllerSettings
) -> PredictorDesign:
    """Return the packet that sends a predictor's commands ahead of time."""
    settings = predictor.model_copy(update={"law": "packet", "packet": PacketSettings()})
    with ThreadPoolExecutor(_THREADS) as pool:
        return describe_predictor(Task(pool, spec, vehicle), settings)


def design_values(settings: ControllerSettings) -> Values:
    """Return what the search of a predictor would have found, of a predictor's settings."""
    tables = {
        **settings.table_of(PredictorSettings).model_dump(),
        **settings.estimator.model_dump(),
    }
    return {key: tables[key] for key in START}


def describe_predictor(task: Task, settings: ControllerSettings) -> PredictorDesign:
    """Return the figures of a predictor."""
    spec, delays_ns = task.spec, task.table.delays_ns
    columns = [runs(task, settings, constant(delay_ns)) for delay_ns in delays_ns]
    road_m = [road_errors_m(task, settings, each) for each in delays_ns if spec.road is not None]
    without = [_without_path(task)] if task.knows_path else []
    without_path_m = [road_errors_m(one, settings, each) for one in without for each in delays_ns]
    return PredictorDesign(
        settings,
        {},
        0,
        delays_ns,
        np.array([worst_m(column, "whole_rms_m") for column in columns]),
        np.array([worst_m(column) for column in columns]),
        *linear_figures(task, settings, delays_ns),
        tuple(worst_m(runs(task, settings, jittered(one))) for one in spec.jitter),
        tuple(largest_error_m(task, settings, met) for met in task.table.conditions),
        _fallback_up_to_ns(task.vehicle, settings),
        np.array(road_m),
        np.array(without_path_m),
    )


def _without_path(task: Task) -> Task:
    """Return the task where the plant does not send PATH_AHEAD."""
    table = task.table
    road = required(table.road).model_copy(update={"path_known": False})
    without = {"predictor": table.model_copy(update={"road": road})}
    return task._replace(spec=task.spec.model_copy(update=without))


def _fallback_up_to_ns(vehicle: VehicleFile, settings: ControllerSettings) -> int:
    """Return up to which constant delay the pd_ddob is stable at every corner."""
    alone = {"law": FALLBACK, "followed_point": "preview"}
    design = design_law(settings.model_copy(update=alone))
    return least_margin_ns(
        SampledLoop(design, model, settings.period_ns) for model in vehicle.models
    )


def _cost(task: Task, settings: ControllerSettings, least: float) -> float:
    """Return the worst error at both ends of the delays and half-way; more for what is exceeded.

    That is the RMS, or on a road the largest deviation; the other car's counts in proportion.
    ``least``  the least cost so far: a road that costs far more is not driven at other delays
    """
    exceeded = next((share for share in _shares(task, settings) if share > 1.0), 0.0)
    if exceeded:
        return LEFT_M * exceeded
    last_ns, road, error_m = task.table.delays_ns[-1], task.spec.road, 0.0
    for delay_ns in (last_ns, last_ns // 2, 0):
        if road is None:
            of_delay_m = worst_m(runs(task, settings, constant(delay_ns)))
        else:
            known_m, other_m = road_errors_m(task, settings, delay_ns)
            of_delay_m = max(known_m, other_m * road.error_m_max / road.off_error_m_max)
        error_m = max(error_m, of_delay_m)
        if road is not None and error_m > _FAR * least:
            break
    return error_m


def _shares(task: Task, settings: ControllerSettings) -> Iterator[float]:
    """Yield how much of each limit is used."""
    spec, table = task.spec, task.table
    linear = linear_figures(task, settings, (0, table.delays_ns[-1]))
    yield linear.noise_gain_rad_m / spec.noise_gain_rad_m_max
    yield linear.peak_sensitivity / spec.peak_sensitivity_max
    for met in table.conditions:
        yield largest_error_m(task, settings, met) / met.error_m_max


def judged_on(task: Task) -> str | None:
    """Return on what a road's design is judged, in words; None for one of a box."""
    if task.spec.road is None:
        return None
    delays = ", ".join(f"{delay_ns / NS_PER_MS:g}" for delay_ns in task.table.delays_ns)
    return "; ".join((*roads_in_words(task.spec.road), f"delays of {delays} ms"))


def _settings(task: Task, fallback: ControllerSettings, values: Values) -> ControllerSettings:
    """Return the settings of a point of the search."""
    table, vehicle = task.table, task.vehicle
    speed = vehicle.vehicle.speed_m_s
    low, high = vehicle.uncertainty.speed_m_s or (speed, speed)
    tables = fallback.model_dump(exclude={"law", "link", "estimator", "validity"})
    tables["predictor"] = PredictorSettings(
        steer_per_error_rad_m=values["steer_per_error_rad_m"],
        horizon_s_max=table.horizon_s_max,
        measures_lag=table.measures_lag,
        measures_mass=table.measures_mass,
        lateral_acceleration_m_s2_max=table.lateral_acceleration_m_s2_max,
        curvature_averaging_s=_CURVATURE_AVERAGING_S if task.knows_path else None,
    )
    tables["nominal_model"] = VehicleModelSettings(**vehicle.vehicle.model_dump())
    settings = ControllerSettings(
        **tables,
        law="predictor",
        validity=validity(vehicle, table.delay_ms_max, judged_on(task)),
        link=LinkSettings(
            sensor_period_ms=fallback.link.sensor_period_ms,
            delay_averaging_s=table.delay_averaging_s,
        ),
        estimator=EstimatorSettings(
            lateral_error_noise_m=table.lateral_error_noise_m,
            heading_error_noise_rad=table.heading_error_noise_rad,
            actuator_dead_time_s=task.steering_s[0],
            speed_m_s_min=round(0.5 * low, 2),
            speed_m_s_max=round(1.5 * high, 2),
            **{key: value for key, value in values.items() if key != "steer_per_error_rad_m"},
        ),
    )
    return with_set_point(task.spec, settings)
