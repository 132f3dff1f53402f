"""Figures of ``--check``: one mapping, ready for JSON; times in seconds, rates in 1/s.

law, rate_hz, period_s
not_analysed           why there is no analysis at all, empty otherwise
opening, closing       of a law that looks back or a loop of two rates: lines before and after the
                       analysis, as printed
law_poles              of the law alone; absent for laws that look back
closed_loop_poles      around the nominal plant, without delay; absent without a model
decay_1_s              of the slowest mode without delay; absent with ``delays``
margins                without delay, at the command on the bus; null where not stable
delays                 of a law that looks back or a loop of two rates: sensitivity and noise at
                       some constant delays
stable_delays          the constant delays at which the loop is stable: ``margin_s`` (null:
                       beyond the search), ``intervals_s``, ``searched_s``
jitter                 for some mean latencies, the standard deviations that are tolerated
delay_max_s            of [validity]; null without
corners                of [validity]: each vehicle, the delay up to which it is judged and its
                       ``stable_delays``; empty without [validity]
fallback               law and ``stable_delays`` of what takes over without echoes; or null
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ...runtime.array_types import ComplexArray, FloatArray
from ...runtime.node import NS_PER_MS, NS_PER_S
from ..filters.nominal_model import NominalVehicle, steer_to_lateral_error
from ..filters.settings import VehicleModelSettings
from ..filters.transfer_function import TransferFunction
from ..law_interface import LookingBack
from ..laws.law_from_settings import LawDesign, design_law, vehicle_of
from ..settings import ControllerSettings
from . import jitter
from .check_verdict import in_words
from .linear_system import NotLinearError, law_system
from .loop_signals import LoopModel
from .periodic_loop import PeriodicLoop, Responses, linear, stable_constant_delays
from .sampled_loop import SLOWEST_DECAY_1_S, SampledLoop
from .stable_delays import DELAY_NS_MAX, Interval, delay_margin_ns, stable_delays

SHOWN_DELAYS_MS = (0, 100, 200, 300, 400, 500)
FILTER_PERIODS_MAX = 100
"""Largest delay for a law with a filter. Every command in transit is a state; with a hundred of
them the whole search takes a minute."""
TWO_RATES_PERIODS_MAX = 300
"""Largest delay for another law at two rates: the search takes some seconds."""

Figures = dict[str, Any]
Progress = Callable[[str], None]
"""Called with what is computed next, in words."""


def check_figures(settings: ControllerSettings, progress: Progress) -> Figures:
    """Return the analysis of the loop around the nominal plant, and at the corners of [validity].

    At a corner, only the delays up to that of [validity] are judged.
    """
    figures = _nominal_figures(settings, progress)
    model, validity = settings.nominal_model, settings.validity
    corners = []
    delay_max_s = None if validity is None else 1e-3 * validity.delay_ms_max
    box = validity if "stable_delays" in figures else None
    if box is not None and box.given() and isinstance(model, VehicleModelSettings):
        searched_ns = round(NS_PER_S * figures["stable_delays"]["searched_s"])
        limit_ns = min(searched_ns, round(box.delay_ms_max * NS_PER_MS))
        responses: Responses = {}
        for vehicle in box.corners(model.vehicle):
            changed = {key: getattr(vehicle, key) for key in box.given()}
            progress(f"stable delays at {in_words(changed)}")
            stable = stable_delays_of(loop_around(settings, vehicle, responses), limit_ns)
            corners.append({"vehicle": changed, "stable_delays": _delays(stable, limit_ns)})
    return figures | {"delay_max_s": delay_max_s, "corners": corners}


Loop = SampledLoop | PeriodicLoop


def loop_around(settings: ControllerSettings, vehicle: NominalVehicle, known: Responses) -> Loop:
    """Return the loop of a law around another vehicle than its nominal one.

    Raises ValueError where the two periods have no common multiple.
    """
    design = _analysed_law(settings)
    if design.looking_back is None:
        return _loop_of(settings, design, vehicle, known)
    return PeriodicLoop(
        design, settings.loop_delay, LoopModel(vehicle, settings.estimator.actuator_lag_s), known
    )


def loop_response(
    settings: ControllerSettings, omega_rad_s: FloatArray, delay_s: float
) -> ComplexArray:
    """Return the open loop around the nominal plant at these ω, with -1 as the critical point.

    Raises ValueError for a loop that has none: of a law that is not linear or looks back, of two
    rates, or without [nominal_model].
    """
    design = _analysed_law(settings)
    if settings.model is None or design.looking_back is not None or _has_two_rates(settings):
        raise ValueError(
            f"law {settings.law}: a loop has one frequency response only if [nominal_model] is"
            " given, the law does not look back, and measurements come as often as commands"
        )
    loop = SampledLoop(design, settings.model, settings.period_ns)
    return loop.responder(round(delay_s * NS_PER_S))(omega_rad_s)


def _analysed_law(settings: ControllerSettings) -> LawDesign:
    """Return the law, without its set point if that is outside the loop."""
    design = design_law(linear(settings))
    if design.looking_back is not None or settings.followed_point == "preview":
        return design
    return design_law(settings.model_copy(update={"followed_point": "preview"}))


def _loop_of(
    settings: ControllerSettings,
    design: LawDesign,
    plant: NominalVehicle | TransferFunction,
    responses: Responses | None = None,
) -> Loop:
    """Return the loop of a law that does not look back."""
    model = steer_to_lateral_error(plant) if isinstance(plant, NominalVehicle) else plant
    if not _has_two_rates(settings):
        return SampledLoop(design, model, settings.period_ns)
    loop_model = LoopModel(plant if design.heading_gain else model)
    return PeriodicLoop(design, settings.loop_delay, loop_model, responses)


def stable_delays_of(loop: Loop, limit_ns: int) -> tuple[Interval, ...]:
    """Return the stable delays of either loop."""
    if isinstance(loop, SampledLoop):
        return stable_delays(loop, limit_ns)
    return stable_constant_delays(loop, limit_ns)


def _has_two_rates(settings: ControllerSettings) -> bool:
    """Whether some ticks have no new measurement, or one that was not taken at the tick."""
    return settings.period_ns % settings.loop_delay.sensor_period_ns != 0


def _delay_ns_max(settings: ControllerSettings, design: LawDesign) -> int:
    if design.looking_back is not None:
        return min(DELAY_NS_MAX, FILTER_PERIODS_MAX * settings.period_ns)
    if _has_two_rates(settings):
        return min(DELAY_NS_MAX, TWO_RATES_PERIODS_MAX * settings.period_ns)
    return DELAY_NS_MAX


def _nominal_figures(settings: ControllerSettings, progress: Progress) -> Figures:
    figures: Figures = {
        "law": settings.law,
        "rate_hz": NS_PER_S / settings.period_ns,
        "period_s": settings.period_ns / NS_PER_S,
        "not_analysed": "",
    }
    design = _analysed_law(settings)
    if design.looking_back is not None:
        lag_s = settings.estimator.actuator_lag_s
        loop_model = LoopModel(vehicle_of(settings).vehicle, lag_s)
        return figures | _looking_back(settings, design, design.looking_back, loop_model, progress)
    try:
        law = law_system(design)
    except NotLinearError as error:
        return figures | {"not_analysed": f"{error}"}
    figures["law_poles"] = _poles(np.linalg.eigvals(law.a).astype(np.complex128), settings)
    if settings.model is None:
        return figures
    if design.heading_gain and not settings.model.heading:
        needed = "a law that reads the heading error needs nominal_model.kind = 'vehicle'"
        return figures | {"not_analysed": needed}
    if _has_two_rates(settings):
        loop_model = LoopModel(
            vehicle_of(settings).vehicle if design.heading_gain else settings.model
        )
        return figures | _looking_back(settings, design, _two_rates(settings), loop_model, progress)
    loop = SampledLoop(design, settings.model, settings.period_ns)
    progress("poles and margins")
    decay_1_s = loop.decay_1_s(0)
    figures |= {
        "closed_loop_poles": _poles(loop.closed_loop_poles(0), settings),
        "decay_1_s": decay_1_s,
        "margins": loop.margins(0)._asdict() if decay_1_s > SLOWEST_DECAY_1_S else None,
    }
    progress("stable delays")
    stable = stable_delays(loop)
    means_ms = jitter.MEANS_MS if stable else ()
    return figures | {
        "stable_delays": _delays(stable),
        "jitter": [_jitter(loop, mean_ms, progress) for mean_ms in means_ms],
        "fallback": None,
    }


def _two_rates(settings: ControllerSettings) -> LookingBack:
    control_ms, sensor_ms = settings.period_ns / NS_PER_MS, settings.link.sensor_period_ms
    return LookingBack(
        (
            f"Control every {control_ms:g} ms, measurements every {sensor_ms:g} ms"
            " (link.sensor_period_ms):",
            "analysed at both rates; gain and phase margins belong to loops of one rate.",
        ),
        (
            "The clocks start together, as in virtual time; on a bus a measurement waits up to",
            f"{min(control_ms, sensor_ms):g} ms more for its tick, which counts as delay.",
        ),
    )


def _looking_back(
    settings: ControllerSettings,
    design: LawDesign,
    law: LookingBack,
    loop_model: LoopModel,
    progress: Progress,
) -> Figures:
    figures: Figures = {"opening": law.opening, "closing": law.closing, "fallback": None}
    limit_ns = _delay_ns_max(settings, design)
    try:
        if law.fallback is not None and settings.model is not None:
            name, when = law.fallback
            progress(f"stable delays of {name}")
            fallback = design_law(settings.model_copy(update={"law": name}))
            fallback_ns = _delay_ns_max(settings, fallback)
            stable = stable_delays_of(_loop_of(settings, fallback, settings.model), fallback_ns)
            delays = _delays(stable, fallback_ns)
            figures["fallback"] = {"law": name, "when": when, "stable_delays": delays}
        loop = PeriodicLoop(design, settings.loop_delay, loop_model)
    except ValueError as error:
        return figures | {"opening": (), "closing": (), "not_analysed": f"{error}"}
    progress("poles and sensitivity")
    longest_ns = FILTER_PERIODS_MAX * settings.period_ns
    shown_ns = [ms * NS_PER_MS for ms in SHOWN_DELAYS_MS if ms * NS_PER_MS <= longest_ns]
    figures |= {
        "closed_loop_poles": _poles(loop.closed_loop_poles(0), settings, loop.period_ns),
        "delays": [_at_delay(loop, delay_ns) for delay_ns in shown_ns],
    }
    progress("stable delays")
    stable = stable_constant_delays(loop, limit_ns)
    return figures | {"stable_delays": _delays(stable, limit_ns)}


def _at_delay(loop: PeriodicLoop, delay_ns: int) -> Figures:
    decay_1_s = loop.decay_1_s(delay_ns)
    is_stable = decay_1_s > SLOWEST_DECAY_1_S
    return {
        "delay_s": delay_ns / NS_PER_S,
        "decay_1_s": decay_1_s,
        "peak_sensitivity": loop.peak_sensitivity(delay_ns) if is_stable else None,
        "noise_gain_rad_m": loop.noise_gain_rad_m(delay_ns) if is_stable else None,
    }


def _poles(
    poles: ComplexArray, settings: ControllerSettings, period_ns: int | None = None
) -> list[Figures]:
    """Return poles, slowest first, a conjugate pair as one."""
    period_ns = period_ns or settings.period_ns
    ordered = sorted(poles, key=lambda pole: (-abs(pole), -pole.real))
    return [
        {
            "real": float(pole.real),
            "imag": float(pole.imag),
            "modulus": float(abs(pole)),
            "decay_1_s": -math.log(abs(pole)) * NS_PER_S / period_ns if pole else math.inf,
            "omega_rad_s": float(abs(np.angle(pole))) * NS_PER_S / period_ns,
        }
        for pole in ordered
        if pole.imag >= 0.0
    ]


def _delays(stable: tuple[Interval, ...], limit_ns: int = DELAY_NS_MAX) -> Figures:
    margin_ns = delay_margin_ns(stable, limit_ns)
    return {
        "margin_s": None if margin_ns is None else margin_ns / NS_PER_S,
        "intervals_s": [[first / NS_PER_S, last / NS_PER_S] for first, last in stable],
        "searched_s": limit_ns / NS_PER_S,
    }


def _jitter(loop: SampledLoop, mean_ms: int, progress: Progress) -> Figures:
    progress(f"jitter at a mean of {mean_ms} ms")
    not_analysed, spreads_s = "", list[list[float]]()
    try:
        spreads = jitter.stable_spreads(loop, mean_ms * NS_PER_MS, jitter.LOSS)
        spreads_s = [[first / NS_PER_S, last / NS_PER_S] for first, last in spreads]
    except jitter.JitterTooLargeError:
        not_analysed = "too many commands on their way at this rate to be analysed"
    found = {"mean_s": 1e-3 * mean_ms, "loss": jitter.LOSS, "not_analysed": not_analysed}
    return found | {"spreads_s": spreads_s}
