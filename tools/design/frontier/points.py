"""The points of the frontier: each structure at its best for a delay, and the paper's own laws.

A structure is designed for the longest delay first. That design meets the demands of a shorter one
too, and the search for the shorter delay begins near it.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from ....controller.analysis.sampled_loop import SampledLoop
from ....controller.analysis.stable_delays import delay_margin_ns, stable_delays
from ....controller.filters.settings import QKind
from ....controller.filters.transfer_function import TransferFunction
from ....controller.laws.law_from_settings import LawDesign, design_law
from ....controller.settings import ControllerSettings, controller_preset
from ....runtime.node import NS_PER_MS, NS_PER_S
from ..demands import Study, judge_law, make_study
from ..loop_figures import behind_lag, frequency_grid, loop_figures
from ..search.evolution import Values
from ..search.law_parameters import controller_settings
from ..search.parameter_search import find
from ..specification import DelayTable, DStabilityTable, Specification, controller_law
from ..vehicle_file import VehicleFile
from .settings import STRUCTURES, FrontierSettings
from .trials import LAG_S, Trials, worst_rms_m

PREDICTOR = "predictor"
"""Not designed here: the shipped preset, at the noise that it was designed for. It reads heading
error, speed and the echoes of its commands too."""
PREDICTOR_PRESET = "practical_predictor"
PUBLISHED = "published"
"""The paper's own controllers, without demands on them."""
FILTERED = "published gains, filter and washout"
"""Those with what the paper does not have: a derivative filter, and a washout in the CDOB, without
which that drifts off the path."""
LAWS = {"PD": "paper_pd", "PD + DOB": "paper_pd_dob", "PD + CDOB": "paper_pd_cdob",
        "PD + DDOB": "paper_pd_ddob"}  # fmt: skip
_FILTER, _WASHOUT = "pd.derivative_filter_rad_s=30", "cdob.washout_rad_s=3"
_POINTS = 1500
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
    noise_gain_rad_m: float = math.nan
    peak_sensitivity: float = math.nan
    margin_ms: float = math.nan
    nominal_ms: float = math.nan
    lagged_ms: float = math.nan
    judged: int = 0
    values: Values = {}  # noqa: RUF012  # never changed
    q_kind: QKind | None = None


class Row(NamedTuple):
    """A structure at a delay, and what its design does in runs."""

    point: Point
    trials: Trials


def designed_points(
    asked: FrontierSettings, vehicle: VehicleFile, structure: str, done: Callable[[float], None]
) -> Iterator[Point]:
    """Yield a point for each delay, the longest first; delays without a design have none.

    A search that is stopped ends it.
    """
    law, _, q_kinds = STRUCTURES[structure]
    known: dict[QKind, Values] = {}
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
            found = find(coarse, fine, law, progress, known.get(q_kind))
            if not found.ended:
                return
            if found.feasible:
                known[q_kind] = found.values
                points.append(point_of(fine, structure, found.values, found.judged))
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


def point_of(fine: Study, structure: str, values: Values, judged: int = 1) -> Point:
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
        *_margins_ms(fine.vehicle, settings),
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


def predictor_points(asked: FrontierSettings, vehicle: VehicleFile) -> Iterator[Point]:
    """Yield the shipped predictor at each delay, the longest first."""
    settings = controller_preset(PREDICTOR_PRESET)
    for delay_ms in reversed(asked.delays_ms):
        yield Point(PREDICTOR, delay_ms, worst_rms_m(asked, vehicle, settings, delay_ms))


def published_points(asked: FrontierSettings, vehicle: VehicleFile) -> Iterator[Point]:
    """Yield a point for each law of the paper, first as published; its structure names both.

    ``delay_ms`` is the margin of the worst corner less the share that all others keep; 0, with an
    infinite error, where the loop drifts off whatever the delay.
    """
    for what, added in ((PUBLISHED, ()), (FILTERED, (_FILTER, _WASHOUT))):
        for name, preset in LAWS.items():
            has_cdob = name.endswith(("CDOB", "DDOB"))
            settings = controller_preset(preset, added if has_cdob else added[:1])
            yield _published_point(asked, vehicle, f"{what}: {name}", settings)


def _published_point(
    asked: FrontierSettings, vehicle: VehicleFile, structure: str, settings: ControllerSettings
) -> Point:
    margins_ms = _margins_ms(vehicle, settings)
    delay_ms = margins_ms[0] / (1.0 + asked.margin_share)
    rms_m = noise_rad_m = peak = math.inf
    if delay_ms:
        rms_m = worst_rms_m(asked, vehicle, settings, delay_ms)
        delays_ns = 0, round(delay_ms * NS_PER_MS)
        grid = frequency_grid(vehicle.models, delays_ns, settings.period_ns, _POINTS)
        figures = loop_figures(grid, design_law(settings))
        noise_rad_m = float(figures.noise_gain_rad_m.max())
        peak = float(figures.peak_sensitivity.max())
    q_kind = None if settings.dob is None else settings.dob.q_kind
    return Point(structure, delay_ms, rms_m, noise_rad_m, peak, *margins_ms, q_kind=q_kind)


def _margins_ms(vehicle: VehicleFile, settings: ControllerSettings) -> tuple[float, float, float]:
    """Return the delay margins of worst corner, nominal vehicle, and worst corner behind a lag."""
    design, nominal = design_law(settings), VehicleFile(vehicle=vehicle.vehicle).models
    lagged = [behind_lag(model, LAG_S) for model in vehicle.models]
    worst, alone, behind = (
        min(_margin_ms(design, model, settings.period_ns) for model in models)
        for models in (vehicle.models, nominal, lagged)
    )
    return worst, alone, behind


def _margin_ms(design: LawDesign, model: TransferFunction, period_ns: int) -> float:
    intervals = stable_delays(SampledLoop(design, model, period_ns), MARGIN_NS_MAX)
    margin_ns = delay_margin_ns(intervals, MARGIN_NS_MAX)
    return (MARGIN_NS_MAX if margin_ns is None else margin_ns) / NS_PER_MS
