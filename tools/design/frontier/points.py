"""Points of the frontier: each structure at its best for a delay.

A structure is designed for the longest delay first. That design meets the demands of a shorter one
too, and the search for the shorter delay begins near it.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ....closed_loop.compiled.engine import run_compiled
from ....closed_loop.compiled.loop_records import rms_of
from ....closed_loop.studies.compiled_runs import verdict_on
from ....controller.analysis.loop_signals import HEADING_NOISE_1_M
from ....controller.analysis.sampled_loop import SampledLoop
from ....controller.analysis.stable_delays import least_margin_ns
from ....controller.filters.settings import QKind
from ....controller.filters.transfer_function import TransferFunction
from ....controller.laws.law_from_settings import design_law
from ....controller.laws.predictor import NAME as PREDICTOR
from ....controller.settings import ControllerSettings, controller_preset
from ....plant_emulator.evaluation.run_verdict import Verdict
from ....plant_emulator.network.settings import LatencySettings
from ....plant_emulator.sensors.settings import SensorNoiseSettings
from ....runtime.node import NS_PER_MS
from ..demands import Bench, judge_law, make_bench, preset_of
from ..loop_figures import behind_lag
from ..predictor_design import design_predictor, design_values, predictor_demands
from ..search.evolution import Values
from ..search.law_parameters import controller_settings
from ..search.parameter_search import find
from ..specification import (
    DelayTable,
    DStabilityTable,
    PredictorTable,
    Specification,
    controller_law,
)
from ..virtual_check import plant_settings
from .settings import STRUCTURES, Panel

_WITHOUT = frozenset({"settling", "PD settling", "PD damping", "PD bandwidth"})
"""Demands that are not made: they say what a loop is like at delays that it meets with ease."""
_STEPS = 12
"""Delays that are tested up to the guaranteed one."""
_STEP_MS_MIN = 5.0
_COARSE_DELAYS = 3
"""Delays that have runs in a coarse search: none, half and all of it."""
MARGIN_NS_MAX = 1_500_000_000
LAG_S = 0.1
"""Of the steering, which the design does not know."""
SENSOR_NOISE_M = 0.02
"""Standard deviation of white noise on the lateral error."""


class Point(NamedTuple):
    """A structure at its best for a delay.

    ``delay_ms``     guaranteed: all demands hold for each constant delay up to it
    ``rms_m``        of the car, worst of corners and delays, without noise
    ``margin_ms``    delay at which the worst corner becomes unstable
    ``lagged_ms``    that delay behind an unknown lag of the steering of 0.1 s
    ``noisy_rms_m``  of a run of the nominal vehicle at the delay, with sensor noise
    ``values``       of the parameters, by their keys in the settings
    ``q_kind``       filter of the DOB; None without one
    """

    panel: str
    structure: str
    delay_ms: float
    rms_m: float
    noise_gain_rad_m: float = math.nan
    peak_sensitivity: float = math.nan
    margin_ms: float = math.nan
    lagged_ms: float = math.nan
    noisy_rms_m: float = math.nan
    judged: int = 0
    values: Values = {}  # noqa: RUF012  # never changed
    q_kind: QKind | None = None


def designed_points(panel: Panel, structure: str) -> Iterator[Point]:
    """Yield a point for each delay, the longest first; delays without a design have none."""
    law, q_kinds = STRUCTURES[structure].law, STRUCTURES[structure].q_kinds
    known: dict[QKind, Values] = {}
    for delay_ms in reversed(panel.table.delays_ms):
        points = []
        for q_kind in q_kinds:
            coarse, fine = (
                bench_for(panel, structure, delay_ms, is_fine, q_kind) for is_fine in (False, True)
            )
            found = find(coarse, fine, law, math.inf, known.get(q_kind))
            if found.feasible:
                known[q_kind] = found.values
                points.append(point_of(panel, fine, structure, found.values, found.judged))
        if points:
            yield min(points, key=lambda point: point.rms_m)


def bench_for(
    panel: Panel, structure: str, delay_ms: float, fine: bool, q_kind: QKind = "type_2"
) -> Bench:
    """Return what a structure is judged by at a delay, coarse for the search or fine."""
    return make_bench(
        specification_for(panel, structure, delay_ms, q_kind),
        panel.vehicle,
        fine=fine,
        without=_WITHOUT,
        takes_map=STRUCTURES[structure].takes_map,
        coarse_delays=_COARSE_DELAYS,
    )


def point_of(panel: Panel, fine: Bench, structure: str, values: Values, judged: int = 1) -> Point:
    """Return the figures of a structure with these parameters, whether it meets them or not."""
    law, spec, vehicle = STRUCTURES[structure].law, fine.spec, fine.vehicle
    settings = controller_settings(spec, vehicle, law, values)
    demands = {demand.name: demand.value for demand in judge_law(fine, law, values).demands}
    lagged = [behind_lag(model, LAG_S) for model in vehicle.models]
    return Point(
        panel.table.name,
        structure,
        spec.delay.ms_max,
        demands.get("RMS error", math.inf),
        demands.get("noise gain", math.inf),
        demands.get("peak sensitivity", math.inf),
        _margin_ms(settings, vehicle.models),
        _margin_ms(settings, lagged),
        noisy_rms_m(panel, preset_of(fine, settings), spec.delay.ms_max),
        judged,
        values,
        spec.dob_q_kind if "dob" in values else None,
    )


def specification_for(
    panel: Panel, structure: str, delay_ms: float, q_kind: QKind = "type_2"
) -> Specification:
    """Return what a structure has to meet at every delay up to one."""
    asked = panel.asked
    step_ms = max(_STEP_MS_MIN, delay_ms / _STEPS)
    return Specification(
        name="frontier",
        laws=(controller_law(STRUCTURES[structure].law),),
        rate_hz=asked.rate_hz,
        peak_sensitivity_max=asked.peak_sensitivity_max,
        noise_gain_rad_m_max=panel.table.noise_gain_rad_m_max,
        dob_q_kind=q_kind,
        delay=DelayTable(ms_max=delay_ms, step_ms=step_ms, margin_ms=asked.margin_share * delay_ms),
        d_stability=DStabilityTable(settling_1_s=0.1, bandwidth_rad_s=5.0),
        ignore_s=asked.ignore_s,
        follows_car=STRUCTURES[structure].follows_car,
        course=panel.table.course,
        search=panel.search,
        predictor=PredictorTable(
            delay_ms_max=delay_ms,
            delay_step_ms=0.5 * delay_ms,
            margin_ms=asked.margin_share * delay_ms,
            fallback=panel.table.predictor,
            generations=panel.table.predictor_generations or asked.predictor_generations,
        ),
    )


def predictor_points(panel: Panel) -> Iterator[Point]:
    """Yield the predictor's point for each delay, the longest first."""
    preset = controller_preset(panel.table.predictor)
    preset = preset.model_copy(update={"followed_point": "centre_of_gravity"})
    shipped = design_values(preset)
    longer = shipped
    for delay_ms in reversed(panel.table.delays_ms):
        spec = specification_for(panel, PREDICTOR, delay_ms)
        near = (longer, shipped)[: panel.search.starts - 1]
        design = design_predictor(spec, panel.vehicle, preset, math.inf, near)
        longer = design.values
        if not any(demand.excess for demand in predictor_demands(spec, design)):
            yield Point(
                panel.table.name,
                PREDICTOR,
                delay_ms,
                float(design.settled_rms_m.max()),
                design.noise_gain_rad_m,
                design.peak_sensitivity,
                noisy_rms_m=noisy_rms_m(panel, design.settings, delay_ms),
                judged=design.judged,
                values=design.values,
            )


def _margin_ms(settings: ControllerSettings, models: Sequence[TransferFunction]) -> float:
    """Return the shortest delay margin of these plants."""
    loops = [SampledLoop(design_law(settings), model, settings.period_ns) for model in models]
    return least_margin_ns(loops, MARGIN_NS_MAX) / NS_PER_MS


def noisy_rms_m(panel: Panel, settings: ControllerSettings, delay_ms: float) -> float:
    """Return the car's RMS, of the nominal vehicle at this delay, with sensor noise.

    The run has the real limits on the commands, frames, and the steering's guard as it is by
    default. Infinite where it does not hold.
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
