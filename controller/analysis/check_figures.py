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
delay_max_s, judged_on  of [validity]; null without
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
from ..laws.law_from_settings import LawDesign, design_law, required
from ..settings import ControllerSettings
from . import jitter
from .check_verdict import in_words
from .linear_system import NotLinearError, law_system
from .loop_signals import LoopModel
from .periodic_loop import PeriodicLoop, Responses, linear
from .sampled_loop import SLOWEST_DECAY_1_S, SampledLoop
from .stable_delays import DELAY_NS_MAX, Loop, delay_margin_ns, stable_delays

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
            stable = _delays(loop_around(settings, vehicle, responses), limit_ns)
            corners.append({"vehicle": changed, "stable_delays": stable})
    judged_on = None if validity is None else validity.judged_on
    return figures | {"delay_max_s": delay_max_s, "judged_on": judged_on, "corners": corners}


def loop_around(
    settings: ControllerSettings,
    plant: NominalVehicle | TransferFunction,
    known: Responses | None = None,
) -> Loop:
    """Return the loop of a law around a plant, its nominal one or another.

    Raises ValueError where the two periods have no common multiple.
    """
    design = _analysed_law(settings)
    if design.looking_back is not None or _has_two_rates(settings):
        return _periodic_loop(settings, plant, known)
    model = steer_to_lateral_error(plant) if isinstance(plant, NominalVehicle) else plant
    return SampledLoop(design, model, settings.period_ns)


def _periodic_loop(
    settings: ControllerSettings,
    plant: NominalVehicle | TransferFunction,
    known: Responses | None = None,
) -> PeriodicLoop:
    design = _analysed_law(settings)
    lag_s = 0.0 if design.looking_back is None else settings.estimator.actuator_lag_s
    return PeriodicLoop(design, settings.loop_delay, LoopModel(plant, lag_s), known)


def loop_response(
    settings: ControllerSettings, omega_rad_s: FloatArray, delay_s: float
) -> ComplexArray:
    """Return the open loop around the nominal plant at these ω, with -1 as the critical point.

    Raises ValueError outside 0 < ω <= π over the period, for a delay below 0, and for a loop that
    has none: of a law that is not linear or looks back, of two rates, or without [nominal_model].
    """
    nyquist_rad_s = math.pi * NS_PER_S / settings.period_ns
    # The end of a logarithmic grid is rounded.
    is_below = omega_rad_s <= nyquist_rad_s * (1.0 + 1e-9)
    if not (np.all((omega_rad_s > 0.0) & is_below) and delay_s >= 0.0):
        raise ValueError(f"omega_rad_s: above 0, up to {nyquist_rad_s:.5g}; delay_s: from 0 on")
    loop = None if settings.model is None else loop_around(settings, settings.model)
    if not isinstance(loop, SampledLoop):
        raise ValueError(
            f"law {settings.law}: a loop has one frequency response only if [nominal_model] is"
            " given, the law does not look back, and measurements come as often as commands"
        )
    return loop.responder(round(delay_s * NS_PER_S))(omega_rad_s)


def _analysed_law(settings: ControllerSettings) -> LawDesign:
    """Return the law, without its set point if that is outside the loop."""
    design = design_law(linear(settings))
    if design.looking_back is not None or settings.followed_point == "preview":
        return design
    return design_law(settings.model_copy(update={"followed_point": "preview"}))


def _has_two_rates(settings: ControllerSettings) -> bool:
    """Whether some ticks have no new measurement, or one that was not taken at the tick."""
    return settings.period_ns % settings.loop_delay.sensor_period_ns != 0


def _nominal_figures(settings: ControllerSettings, progress: Progress) -> Figures:
    figures: Figures = {
        "law": settings.law,
        "rate_hz": NS_PER_S / settings.period_ns,
        "period_s": settings.period_ns / NS_PER_S,
        "not_analysed": "",
    }
    design, model = _analysed_law(settings), settings.model
    looking_back = design.looking_back
    if looking_back is None:
        try:
            law = law_system(design)
        except NotLinearError as error:
            return figures | {"not_analysed": f"{error}"}
        poles = np.linalg.eigvals(law.a).astype(np.complex128)
        figures["law_poles"] = _poles(poles, settings.period_ns)
        if _has_two_rates(settings):
            looking_back = _two_rates(settings)
    if model is None:
        return figures
    if design.heading_gain and not model.heading:
        needed = "a law that reads the heading error needs nominal_model.kind = 'vehicle'"
        return figures | {"not_analysed": needed}
    if looking_back is not None:
        return figures | _looking_back(settings, looking_back, progress)
    loop = SampledLoop(design, model, settings.period_ns)
    progress("poles and margins")
    decay_1_s = loop.decay_1_s(0)
    figures |= {
        "closed_loop_poles": _poles(loop.closed_loop_poles(0), loop.period_ns),
        "decay_1_s": decay_1_s,
        "margins": loop.margins(0)._asdict() if decay_1_s > SLOWEST_DECAY_1_S else None,
    }
    progress("stable delays")
    stable = _delays(loop)
    means_ms = jitter.MEANS_MS if stable["intervals_s"] else ()
    return figures | {
        "stable_delays": stable,
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


def _looking_back(settings: ControllerSettings, law: LookingBack, progress: Progress) -> Figures:
    figures: Figures = {"opening": law.opening, "closing": law.closing, "fallback": None}
    model = settings.nominal_model
    plant = model.vehicle if isinstance(model, VehicleModelSettings) else required(settings.model)
    try:
        if law.fallback is not None:
            name, when = law.fallback
            progress(f"stable delays of {name}")
            delays = _delays(loop_around(settings.model_copy(update={"law": name}), plant))
            figures["fallback"] = {"law": name, "when": when, "stable_delays": delays}
        loop = _periodic_loop(settings, plant)
    except ValueError as error:
        return figures | {"opening": (), "closing": (), "not_analysed": f"{error}"}
    progress("poles and sensitivity")
    longest_ns = FILTER_PERIODS_MAX * settings.period_ns
    shown_ns = [ms * NS_PER_MS for ms in SHOWN_DELAYS_MS if ms * NS_PER_MS <= longest_ns]
    figures |= {
        "closed_loop_poles": _poles(loop.closed_loop_poles(0), loop.period_ns),
        "delays": [_at_delay(loop, delay_ns) for delay_ns in shown_ns],
    }
    progress("stable delays")
    return figures | {"stable_delays": _delays(loop)}


def _at_delay(loop: PeriodicLoop, delay_ns: int) -> Figures:
    decay_1_s = loop.decay_1_s(delay_ns)
    is_stable = decay_1_s > SLOWEST_DECAY_1_S
    return {
        "delay_s": delay_ns / NS_PER_S,
        "decay_1_s": decay_1_s,
        "peak_sensitivity": loop.peak_sensitivity(delay_ns) if is_stable else None,
        "noise_gain_rad_m": loop.noise_gain_rad_m(delay_ns) if is_stable else None,
    }


def _poles(poles: ComplexArray, period_ns: int) -> list[Figures]:
    """Return poles, slowest first, a conjugate pair as one."""
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


def _delays(loop: Loop, limit_ns: int | None = None) -> Figures:
    """Return the stable delays up to a limit, by default as far as takes seconds."""
    if limit_ns is None:
        limit_ns = DELAY_NS_MAX
        if isinstance(loop, PeriodicLoop):
            periods = FILTER_PERIODS_MAX if loop.looks_back else TWO_RATES_PERIODS_MAX
            limit_ns = min(limit_ns, periods * loop.control_period_ns)
    stable = stable_delays(loop, limit_ns)
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
