"""Judgement of a law by all demands of a specification, over all corners and delays.

The plants and the frames of the runs do not depend on the law, and are made once. A bench is
coarse, for the search, or fine, for the result. They differ in the number of delays and of points
on the frequency axis. The runs are compiled, which gives the numbers of both nodes in virtual time.
Neither node limits the commands in them: how much steer a law takes is demanded of it.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...closed_loop.compiled.schedule import RunSchedule, schedule_run
from ...closed_loop.parameter_space.d_stability import in_s_plane, judge
from ...controller.analysis.sampled_loop import SampledLoop
from ...controller.filters.transfer_function import TransferFunction
from ...controller.laws.feed_forward import FeedForwardSettings
from ...controller.laws.law_from_settings import design_law
from ...controller.limits.steer_limits import LimitSettings
from ...controller.settings import ControllerSettings
from ...dbc.messages import SteeringCommand, limits
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.steering.settings import SafetySettings
from .loop_figures import CircleGrid, behind_lag, circle_grid, loop_figures
from .search.evolution import Values
from .search.law_parameters import KEYS, controller_settings, with_set_point
from .specification import Specification
from .vehicle_file import VehicleFile
from .virtual_check import Driven, constant, drive, plants

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
_NO_GUARD = SafetySettings(
    angle_rad_max="off",
    angle_rate_rad_s_max="off",
    lateral_acceleration_m_s2_max="off",
    lateral_jerk_m_s3_max="off",
    follow_tolerance_rad="off",
)
_LIMITLESS = LimitSettings(
    steer_rad_max=limits(SteeringCommand)["steer_rad"].maximum, steer_rate_rad_s_max=1000.0
)
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


Runs = tuple[RunSchedule, list[PlantSettings]]
"""The instants of runs behind one delay, and the plants of every path and corner."""


class DecayDemand(NamedTuple):
    """How fast every mode of a law has to decay around these plants, at each delay."""

    models: Sequence[TransferFunction]
    delays_ns: tuple[int, ...]
    decay_1_s: float


class Bench(NamedTuple):
    """What a law is judged on, and what of the computation no law changes."""

    spec: Specification
    vehicle: VehicleFile
    runs: Mapping[int, Runs]  # by the delay [ns]
    frequency: CircleGrid
    stability: Mapping[str, DecayDemand]
    without: frozenset[str]  # demands that are not made
    takes_map: bool  # whether the steer for the map's curvature is added to the law's


def make_bench(
    spec: Specification,
    vehicle: VehicleFile,
    *,
    fine: bool,
    without: frozenset[str] = frozenset(),
    takes_map: bool = False,
    coarse_delays: int = _COARSE_DELAYS,
) -> Bench:
    """Return a bench; a coarse one has runs at so many delays."""
    models, settling_1_s, delay = vehicle.models, spec.d_stability.settling_1_s, spec.delay
    beyond_ns = delay.up_to_ns(delay.ms_max + delay.margin_ms)
    stability = {
        "settling": DecayDemand(models, spec.delays_ns, settling_1_s),
        "delay margin": DecayDemand(models, beyond_ns, _MARGIN_DECAY_1_S),
    }
    if spec.actuator is not None:
        lagged = [behind_lag(model, spec.actuator.lag_s) for model in models]
        lag_delays_ns = delay.up_to_ns(spec.actuator.delay_ms_max)
        stability["actuator lag"] = DecayDemand(lagged, lag_delays_ns, _MARGIN_DECAY_1_S)
    delays_ns = spec.delays_ns
    if not fine:
        delays_ns = _thinned(delays_ns, coarse_delays)
        stability = {
            name: demand._replace(delays_ns=_thinned(demand.delays_ns, coarse_delays))
            for name, demand in stability.items()
        }
    return Bench(
        spec,
        vehicle,
        runs_at(spec, vehicle, delays_ns),
        circle_grid(
            models, spec.delays_ns, spec.period_ns, _FINE_POINTS if fine else _COARSE_POINTS
        ),
        {name: demand for name, demand in stability.items() if name not in without},
        without,
        takes_map,
    )


def runs_at(spec: Specification, vehicle: VehicleFile, delays_ns: Iterable[int]) -> dict[int, Runs]:
    """Return the runs at each delay."""
    any_law = controller_settings(spec, vehicle, "pd", dict.fromkeys(KEYS["pd"], 1.0))
    at_delay = {
        each: plants(spec, vehicle, [constant(each)], safety=_NO_GUARD) for each in delays_ns
    }
    return {each: (schedule_run(asked[0], any_law), asked) for each, asked in at_delay.items()}


def judge_law(bench: Bench, law: str, values: Values) -> Judgement:
    """Judge a law with these parameters, the cheap demands first.

    What means nothing for an unstable loop is left out then, and the runs where the other demands
    are far from met.
    """
    spec = bench.spec
    settings = controller_settings(spec, bench.vehicle, law, values)
    design = design_law(settings)
    demands, lacking = [], list[float]()
    for name, demanded in bench.stability.items():
        loops = [SampledLoop(design, model, spec.period_ns) for model in demanded.models]
        decays_1_s = [loop.decay_1_s(each) for loop in loops for each in demanded.delays_ns]
        missing_1_s = [max(0.0, demanded.decay_1_s - decay_1_s) for decay_1_s in decays_1_s]
        demands.append(Demand(name, float(np.count_nonzero(missing_1_s)), 0.0))
        lacking += missing_1_s
    if any(lacking):
        share = np.count_nonzero(lacking) / len(lacking)
        slowness = sum(lacking) / len(lacking) / spec.d_stability.settling_1_s
        return Judgement(np.inf, _UNSTABLE + share + slowness, tuple(demands))
    if not bench.without.issuperset(_OF_THE_PD):
        demands += _region(bench, settings)
    figures = loop_figures(bench.frequency, design)
    demands += [
        Demand("peak sensitivity", figures.peak_sensitivity, spec.peak_sensitivity_max),
        Demand("noise gain", figures.noise_gain_rad_m, spec.noise_gain_rad_m_max),
    ]
    rough = _judged(bench, np.inf, demands)
    if rough.violation > _NEARLY_MET:
        return rough
    demands += _runs(bench, settings, law)
    (objective,) = (demand.value for demand in demands if demand.name == "RMS error")
    return _judged(bench, objective, demands)


def _judged(bench: Bench, objective: float, demands: list[Demand]) -> Judgement:
    made = tuple(demand for demand in demands if demand.name not in bench.without)
    return Judgement(objective, sum(demand.excess for demand in made), made)


def _region(bench: Bench, settings: ControllerSettings) -> list[Demand]:
    """Return how many loops of the PD alone fail each part of the D-stability."""
    alone = settings.model_copy(update={"law": "pd", "pid": None, "dob": None, "cdob": None})
    pd_design = design_law(alone)
    table, period_ns = bench.spec.d_stability, bench.spec.period_ns
    parts = []
    for model in bench.vehicle.models:
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


def _runs(bench: Bench, settings: ControllerSettings, law: str) -> list[Demand]:
    limits, largest_m = bench.spec.limits, bench.spec.rms_m_max_of(law)
    runs = [run for of_delay in driven(bench, settings).values() for run in of_delay]
    worst = Driven(*np.max(runs, axis=0).tolist())
    return [
        Demand("RMS error", worst.rms_m, largest_m or np.inf),
        Demand("steer", worst.steer_rad, limits.steer_rad_max),
        Demand("steer rate", worst.steer_rate_rad_s, limits.steer_rate_rad_s_max),
    ]


def preset_of(bench: Bench, settings: ControllerSettings) -> ControllerSettings:
    """Return a law with its set point, and with the steer for the map's curvature."""
    feed_forward = FeedForwardSettings() if bench.takes_map else None
    preset = with_set_point(bench.spec, settings)
    return preset.model_copy(update={"feed_forward": feed_forward})


def driven(bench: Bench, settings: ControllerSettings) -> dict[int, list[Driven]]:
    """Return the runs of a law on every path and corner, by the delay."""
    preset = preset_of(bench, settings).model_copy(update={"limits": _LIMITLESS})
    return {
        delay_ns: [drive(bench.spec, plant, preset, plan) for plant in asked]
        for delay_ns, (plan, asked) in bench.runs.items()
    }


def _thinned(delays_ns: tuple[int, ...], count: int) -> tuple[int, ...]:
    last = len(delays_ns) - 1
    picked = {round(last * index / max(1, count - 1)) for index in range(count)}
    return tuple(delays_ns[index] for index in sorted(picked))
