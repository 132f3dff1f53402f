"""Judges a law by all demands of a specification, over all corners and delays.

The plants' responses and the paths do not depend on the law, and are computed once. A study is
coarse, for the search, or fine, for the result. They differ in the number of delays at which the
RMS is computed and of points on the frequency axis.

The runs of a specification as the vehicle feels them: curvature over time at its speed.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache, partial
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from ...closed_loop.parameter_space.d_stability import in_s_plane, judge
from ...controller.analysis.sampled_loop import SampledLoop
from ...controller.filters.settings import VehicleModelSettings
from ...controller.filters.transfer_function import TransferFunction
from ...controller.law_interface import VehicleReading
from ...controller.laws.feed_forward import steer_per_curvature
from ...controller.laws.law_from_settings import LawDesign, steady_steer
from ...controller.laws.set_point import NO_SET_POINT, set_point_params, set_point_step
from ...plant_emulator.path.path import Path, curvature
from ...plant_emulator.path.path_from_settings import build_path
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S
from .loop_figures import CircleGrid, behind_lag, circle_grid, loop_figures
from .search.evolution import Values
from .search.law_parameters import controller_settings, designs
from .specification import Specification
from .tracking import TrackingGrid, rms_m, track, tracking_grid, unsteered_errors
from .vehicle_file import VehicleFile

_BEHIND = 8
"""Parts of the way from car to preview point in which curvature is taken as constant."""
_SAMPLES_PER_TICK = 4
"""Between two, curvature is taken as linear, which is exact except at the path's break points."""


def course_grid(
    spec: Specification, vehicle: VehicleFile, delays_ns: Sequence[int], *, takes_map: bool = False
) -> TrackingGrid:
    """Return the runs of a specification, judged by the car.

    ``takes_map``  whether the law's steer is added to that for the map's curvature
    """
    speeds_m_s = [corner.speed_m_s for corner in vehicle.box.vertices()]
    runs = []
    for path in map(build_path, spec.course.paths):
        of_speed = lru_cache(partial(_met, spec, vehicle, path))
        runs.append([of_speed(speed_m_s) for speed_m_s in speeds_m_s])
    error_m, heading_rad, steer_rad, set_point_m, bend_m = np.moveaxis(np.array(runs), 2, 0)
    offset_m = -vehicle.vehicle.preview_distance_m * heading_rad - bend_m
    if spec.follows_car:
        error_m, offset_m = error_m - set_point_m, offset_m + set_point_m
    return tracking_grid(
        vehicle.models,
        np.stack([error_m, heading_rad]),
        delays_ns,
        spec.period_ns,
        max(1, round(spec.ignore_s * NS_PER_S / spec.period_ns)),
        steer_rad if takes_map else None,
        offset_m,
        vehicle.vehicle.preview_distance_m,
    )


def _met(spec: Specification, vehicle: VehicleFile, path: Path, speed_m_s: float) -> FloatArray:
    """Return what a path asks of the vehicle at a speed, at the ticks; shape (5, ticks).

    Lateral error [m] and heading error [rad] without steering; the nominal vehicle's steady steer
    for the curvature at the preview point [rad]; y*, which puts the car on the path [m]; g, how far
    the path bends away between preview point and car [m].
    """
    nominal = VehicleModelSettings(**vehicle.vehicle.model_dump())
    preview_m, period_s = nominal.preview_distance_m, spec.period_ns / NS_PER_S
    interval_s = period_s / _SAMPLES_PER_TICK
    count = (spec.ticks - 1) * _SAMPLES_PER_TICK + 1
    met = np.array([curvature(path, speed_m_s * interval_s * index) for index in range(count)])
    error_m, heading_rad = unsteered_errors(met, interval_s, speed_m_s, _SAMPLES_PER_TICK)
    at_ticks = met[::_SAMPLES_PER_TICK]
    set_point = set_point_params("centre_of_gravity", nominal, period_s)
    readings = (VehicleReading(speed_m_s, 0.0, rho) for rho in at_ticks.tolist())
    _, *states = accumulate(readings, partial(set_point_step, set_point), initial=NO_SET_POINT)
    set_point_m = np.array([state.shown.value for state in states])
    behind_m = preview_m * (np.arange(_BEHIND) + 0.5) / _BEHIND
    weights_m2 = (preview_m - behind_m) * preview_m / _BEHIND
    at_m = speed_m_s * period_s * np.arange(spec.ticks)
    bend_m = sum(
        weight * np.array([curvature(path, each) for each in (at_m - way).tolist()])
        for weight, way in zip(weights_m2, behind_m, strict=True)
    )
    steer_rad = steer_per_curvature(steady_steer(nominal), speed_m_s) * at_ticks
    return np.stack([error_m, heading_rad, steer_rad, set_point_m, np.asarray(bend_m)])


_ACTIVE = 0.02
"""A demand is active if the law is within this share of its limit."""
_MARGIN_DECAY_1_S = 0.02
"""How fast a loop has to settle to count as stable beyond the range."""
_COARSE_DELAYS = 6
_COARSE_POINTS, _FINE_POINTS = 300, 1500
_UNSTABLE = 100.0
"""Violation of an unstable design, to which the share of unstable loops is added."""
_NEARLY_MET = 0.5
"""Violation up to which the runs are judged too."""
OF_THE_STEER = frozenset({"steer", "steer rate"})
"""Without them the runs take half the time."""
_OF_THE_PD = frozenset({"PD settling", "PD damping", "PD bandwidth"})


class Demand(NamedTuple):
    """One demand and how far a law is from it.

    ``value``  what the law has; of a count, how many loops or roots fail
    ``limit``  the most it may be
    """

    name: str
    value: float
    limit: float

    @property
    def excess(self) -> float:
        """By what share of the limit the value exceeds it, 0 if it does not; a count as it is."""
        beyond = max(0.0, self.value - self.limit)
        return beyond / self.limit if self.limit else beyond

    @property
    def is_active(self) -> bool:
        """Whether the value is so near its limit that this demand shapes the law."""
        return self.limit > 0.0 and self.value > (1.0 - _ACTIVE) * self.limit


class Judgement(NamedTuple):
    """A law under all demands.

    ``objective``  the worst RMS [m], which is minimised; infinite where a loop is unstable
    ``violation``  0 if all demands are met, else the larger the further from it
    """

    objective: float
    violation: float
    demands: tuple[Demand, ...]


class DecayDemand(NamedTuple):
    """How fast every mode of a law has to decay around these plants, at each delay."""

    models: Sequence[TransferFunction]
    delays_ns: tuple[int, ...]
    decay_1_s: float


class Study(NamedTuple):
    """A specification and a vehicle, and what of the computation is the same for every law."""

    spec: Specification
    vehicle: VehicleFile
    tracking: TrackingGrid
    frequency: CircleGrid
    stability: Mapping[str, DecayDemand]
    without: frozenset[str]  # demands that are not made


def make_study(
    spec: Specification,
    vehicle: VehicleFile,
    *,
    fine: bool,
    without: frozenset[str] = frozenset(),
    takes_map: bool = False,
    coarse_delays: int = _COARSE_DELAYS,
) -> Study:
    """Return a study.

    ``without``    names of demands to leave out
    ``takes_map``  as in ``course_grid``
    ``coarse_delays``  at which a coarse study has runs
    """
    models, settling_1_s = vehicle.models, spec.d_stability.settling_1_s
    stability = {
        "settling": DecayDemand(models, spec.delays_ns, settling_1_s),
        "delay margin": DecayDemand(models, spec.margin_delays_ns, _MARGIN_DECAY_1_S),
    }
    if spec.actuator is not None:
        lagged = [behind_lag(model, spec.actuator.lag_s) for model in models]
        stability["actuator lag"] = DecayDemand(lagged, spec.lag_delays_ns, _MARGIN_DECAY_1_S)
    delays_ns = spec.delays_ns
    if not fine:
        delays_ns = _thinned(delays_ns, coarse_delays)
        stability = {
            name: demand._replace(delays_ns=_thinned(demand.delays_ns, coarse_delays))
            for name, demand in stability.items()
        }
    return Study(
        spec,
        vehicle,
        course_grid(spec, vehicle, delays_ns, takes_map=takes_map),
        circle_grid(
            models, spec.delays_ns, spec.period_ns, _FINE_POINTS if fine else _COARSE_POINTS
        ),
        {name: demand for name, demand in stability.items() if name not in without},
        without,
    )


def judge_law(study: Study, law: str, values: Values) -> Judgement:
    """Judge a law with these parameters, the cheap demands first.

    What means nothing for an unstable loop is left out then, and the runs where the other demands
    are far from met.
    """
    spec = study.spec
    settings = controller_settings(spec, study.vehicle, law, values)
    design, pd_design = designs(settings)
    demands, lacking = [], list[float]()
    for name, demanded in study.stability.items():
        loops = [SampledLoop(design, model, spec.period_ns) for model in demanded.models]
        decays_1_s = [loop.decay_1_s(each) for loop in loops for each in demanded.delays_ns]
        missing_1_s = [max(0.0, demanded.decay_1_s - decay_1_s) for decay_1_s in decays_1_s]
        demands.append(Demand(name, float(np.count_nonzero(missing_1_s)), 0.0))
        lacking += missing_1_s
    if any(lacking):
        share = np.count_nonzero(lacking) / len(lacking)
        slowness = sum(lacking) / len(lacking) / spec.d_stability.settling_1_s
        return Judgement(np.inf, _UNSTABLE + share + slowness, tuple(demands))
    if not study.without.issuperset(_OF_THE_PD):
        demands += _region(study, pd_design)
    figures = loop_figures(study.frequency, design)
    peak, noise_rad_m = figures.peak_sensitivity.max(), figures.noise_gain_rad_m.max()
    demands += [
        Demand("peak sensitivity", float(peak), spec.peak_sensitivity_max),
        Demand("noise gain", float(noise_rad_m), spec.noise_gain_rad_m_max),
    ]
    if sum(demand.excess for demand in _made(study, demands)) > _NEARLY_MET:
        return _judged(study, np.inf, demands)
    demands += _runs(study, design, law)
    (objective,) = (demand.value for demand in demands if demand.name == "RMS error")
    return _judged(study, objective, demands)


def _made(study: Study, demands: Iterable[Demand]) -> tuple[Demand, ...]:
    return tuple(demand for demand in demands if demand.name not in study.without)


def _judged(study: Study, objective: float, demands: list[Demand]) -> Judgement:
    made = _made(study, demands)
    return Judgement(objective, sum(demand.excess for demand in made), made)


def _region(study: Study, pd_design: LawDesign) -> list[Demand]:
    """Return how many loops of the PD alone fail each part of the D-stability."""
    table, period_ns = study.spec.d_stability, study.spec.period_ns
    parts = []
    for model in study.vehicle.models:
        loop = SampledLoop(pd_design, model, period_ns)
        for delay_ns in table.delays_ns:
            roots = in_s_plane(loop.closed_loop_poles(delay_ns), period_ns)
            parts.append(judge(table.demands, roots[None]))
    failing = {
        "PD settling": sum(not part.settled[0] for part in parts),
        "PD damping": sum(not part.damped[0] for part in parts),
        "PD bandwidth": sum(not part.dominant[0] for part in parts),
    }
    return [Demand(name, count / len(parts), 0.0) for name, count in failing.items()]


def _runs(study: Study, design: LawDesign, law: str) -> list[Demand]:
    limits, largest_m = study.spec.limits, study.spec.rms_m_max_of(law)
    rms_m_max = np.inf if largest_m is None else largest_m
    if study.without.issuperset(OF_THE_STEER):
        return [Demand("RMS error", float(rms_m(study.tracking, design).max()), rms_m_max)]
    tracking = track(study.tracking, design)
    return [
        Demand("RMS error", float(tracking.rms_m.max()), rms_m_max),
        Demand("steer", float(tracking.steer_rad.max()), limits.steer_rad_max),
        Demand("steer rate", float(tracking.steer_rate_rad_s.max()), limits.steer_rate_rad_s_max),
    ]


def _thinned(delays_ns: tuple[int, ...], count: int) -> tuple[int, ...]:
    last = len(delays_ns) - 1
    picked = {round(last * index / max(1, count - 1)) for index in range(count)}
    return tuple(delays_ns[index] for index in sorted(picked))
