"""Designs one structure for each delay, from the longest to the shortest.

A design for a longer delay meets the demands of a shorter one. It is judged there as well, and the
search for the shorter delay goes on from it.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from ....controller.analysis.sampled_loop import SampledLoop
from ....controller.analysis.stable_delays import delay_margin_ns, stable_delays
from ....controller.filters.settings import QKind
from ....controller.filters.transfer_function import TransferFunction
from ....controller.laws.law_from_settings import LawDesign, design_law
from ....controller.settings import ControllerSettings
from ....runtime.node import NS_PER_MS, NS_PER_S
from ..demands import Study, judge_law, make_study
from ..loop_figures import behind_lag
from ..search.law_parameters import Candidate, controller_settings
from ..search.parameter_search import find
from ..specification import DelayTable, DStabilityTable, Specification, controller_law
from ..vehicle_file import VehicleFile
from .settings import STRUCTURES, FrontierSettings

_WITHOUT = frozenset({"settling", "PD settling", "PD damping", "PD bandwidth"})
"""Demands that are not made: they say what a loop is like at delays that it meets with ease."""
_STEPS = 12
"""Delays that are tested up to the guaranteed one."""
_STEP_MS_MIN = 5.0
MARGIN_NS_MAX = 1_500_000_000


class Point(NamedTuple):
    """A structure at its best for a delay.

    ``delay_ms``     guaranteed: all demands hold for each constant delay up to it
    ``rms_m``        of the preview point's error, worst of corners and delays, without noise
    ``margin_ms``    delay at which the worst corner becomes unstable
    ``nominal_ms``   the same of the nominal vehicle
    ``lagged_ms``    the same of the worst corner, behind the lag of the trials
    ``values``       of the parameters, by their keys in the settings
    ``q_kind``       filter of the DOB; None without one
    """

    structure: str
    delay_ms: float
    rms_m: float
    noise_gain_rad_m: float
    peak_sensitivity: float
    margin_ms: float
    nominal_ms: float
    lagged_ms: float
    judged: int
    values: dict[str, float]
    q_kind: QKind | None = None


def sweep(
    asked: FrontierSettings, vehicle: VehicleFile, structure: str, done: Callable[[float], None]
) -> Iterator[Point]:
    """Yield a point for each delay, the longest first; delays without a design have none."""
    law, _, q_kinds = STRUCTURES[structure]
    known: dict[QKind, list[Candidate]] = {kind: [] for kind in q_kinds}
    searches = len(asked.delays_ms) * len(q_kinds)
    for index, delay_ms in enumerate(reversed(asked.delays_ms)):
        points = []
        for place, q_kind in enumerate(q_kinds, index * len(q_kinds)):

            def progress(share: float, _best: float, place: int = place) -> None:
                done((place + share) / searches)

            coarse, fine = (
                study(asked, vehicle, structure, delay_ms, is_fine, q_kind)
                for is_fine in (False, True)
            )
            found = find(coarse, fine, law, progress, known[q_kind])
            if found.feasible:
                known[q_kind] = [found.candidate]
                values = found.candidate.values()
                points.append(point_of(fine, asked, structure, values, found.judged))
        if points:
            yield min(points, key=lambda point: point.rms_m)


def study(
    asked: FrontierSettings,
    vehicle: VehicleFile,
    structure: str,
    delay_ms: float,
    fine: bool,
    q_kind: QKind = "type_2",
) -> Study:
    """Return what a structure is judged by at a delay, coarse for the search or fine."""
    law, takes_map, _ = STRUCTURES[structure]
    spec = specification_for(asked, law, delay_ms, q_kind)
    first_tick = max(1, round(asked.ignore_s * NS_PER_S / spec.period_ns))
    return make_study(
        spec, vehicle, fine=fine, without=_WITHOUT, takes_map=takes_map, first_tick=first_tick
    )


def point_of(
    fine: Study, asked: FrontierSettings, structure: str, values: dict[str, float], judged: int = 1
) -> Point:
    """Return the figures of a structure with these parameters, whether it meets them or not."""
    law, spec = STRUCTURES[structure].law, fine.spec
    settings = controller_settings(spec, fine.vehicle, law, values)
    demands = {demand.name: demand.value for demand in judge_law(fine, law, values).demands}
    return Point(
        structure,
        spec.delay.ms_max,
        demands.get("RMS error", math.inf),
        demands.get("noise gain", math.inf),
        demands.get("peak sensitivity", math.inf),
        *margins_ms(settings, fine.vehicle, asked.trials.lag_s),
        judged,
        values,
        spec.dob_q_kind if "dob" in values else None,
    )


def specification_for(
    asked: FrontierSettings, law: str, delay_ms: float, q_kind: QKind = "type_2"
) -> Specification:
    """Return what a structure has to meet at every delay up to one."""
    step_ms = max(_STEP_MS_MIN, delay_ms / _STEPS)
    return Specification(
        name="frontier",
        laws=(controller_law(law),),
        rate_hz=asked.rate_hz,
        peak_sensitivity_max=asked.peak_sensitivity_max,
        noise_gain_rad_m_max=asked.noise_gain_rad_m_max,
        dob_q_kind=q_kind,
        delay=DelayTable(ms_max=delay_ms, step_ms=step_ms, margin_ms=asked.margin_share * delay_ms),
        d_stability=DStabilityTable(settling_1_s=0.1, bandwidth_rad_s=5.0),
        course=asked.course,
        search=asked.search,
    )


def margins_ms(
    settings: ControllerSettings, vehicle: VehicleFile, lag_s: float
) -> tuple[float, float, float]:
    """Return the delay margins of worst corner, nominal vehicle, and worst corner behind a lag."""
    design, nominal = design_law(settings), VehicleFile(vehicle=vehicle.vehicle).models
    corners = vehicle.models
    lagged = [behind_lag(model, lag_s) for model in corners]
    return (
        min(_margin_ms(design, model, settings.period_ns) for model in corners),
        min(_margin_ms(design, model, settings.period_ns) for model in nominal),
        min(_margin_ms(design, model, settings.period_ns) for model in lagged),
    )


def _margin_ms(design: LawDesign, model: TransferFunction, period_ns: int) -> float:
    intervals = stable_delays(SampledLoop(design, model, period_ns), MARGIN_NS_MAX)
    margin_ns = delay_margin_ns(intervals, MARGIN_NS_MAX)
    return (MARGIN_NS_MAX if margin_ns is None else margin_ns) / NS_PER_MS
