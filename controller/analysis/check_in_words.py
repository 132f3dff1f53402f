"""Text of ``steer-by-wire check``: the verdict, the settings, and what the loop tolerates.

The text as a whole is a settings file again: all but the settings are TOML comments.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from textwrap import wrap
from typing import Any

from ...runtime.settings.toml_text import dump_toml
from ..settings import ControllerSettings
from .check_figures import check_figures
from .check_verdict import found_in, in_ms, in_words
from .sampled_loop import SLOWEST_DECAY_1_S

_MODULUS_SHOWN_MIN = 1e-3
"""Poles closer to z = 0 belong to memory that is empty after a few periods."""
_PER_MS = 1e3
_RANGES_PER_LINE = 3
_WIDTH = 98

Figures = Mapping[str, Any]


def check_text(settings: ControllerSettings, figures: Figures | None = None) -> str:
    """Return the verdict, the settings, and the analysis of their loop as text.

    ``figures``  of ``check_figures``; computed unless given
    """
    if figures is None:
        figures = check_figures(settings, lambda _what: None)
    ns = round(1e9 * figures["period_s"])
    comments = [f"Runs at {figures['rate_hz']:.9g} Hz, every {ns} ns.", ""]
    comments += _analysis(settings, figures)
    lines = [f"# {comment}" if comment else "#" for comment in comments]
    verdict = f"# verdict: {found_in(figures)}"
    # At the end too, where a terminal shows it.
    texts = [verdict, "", dump_toml(settings, _unused(settings)), *lines, "#", verdict, ""]
    return "\n".join(texts)


def _unused(settings: ControllerSettings) -> list[str]:
    """Return the tables that the law does not read, as far as they have their default values."""
    is_default = settings.estimator == type(settings).model_fields["estimator"].default
    return ["estimator"] if settings.law != "predictor" and is_default else []


def _analysis(settings: ControllerSettings, figures: Figures) -> Iterator[str]:
    looks_back = "opening" in figures
    if settings.feed_forward is not None and not looks_back:
        yield "The feed-forward of the curve is outside the loop: it changes none of what follows."
        yield ""
    if settings.followed_point != "preview" and not looks_back:
        yield "The set point of the followed point is outside the loop: it changes none of it."
        yield ""
    if figures["not_analysed"]:
        yield from wrap(f"Not analysed: {figures['not_analysed']}.", _WIDTH)
    elif looks_back:
        yield from figures["opening"]
        yield ""
    else:
        yield "Poles of the law alone:"
        yield from _poles(figures["law_poles"])
        yield ""
    if "closed_loop_poles" in figures:
        yield from _closed_loop(figures)
    elif not figures["not_analysed"]:
        yield "There is no [nominal_model], hence no closed loop to analyse."
    if looks_back:
        yield ""
        yield from _fallback(figures["fallback"])
        yield from figures["closing"]
        yield "Latency that varies is for simulation: steer-by-wire study."
    yield from _corners(figures["corners"])
    if figures["judged_on"]:
        yield from wrap(f"The preset's errors were judged on: {figures['judged_on']}.", _WIDTH)


def _closed_loop(figures: Figures) -> Iterator[str]:
    yield "Poles of the closed loop around the nominal plant, without delay:"
    yield from _poles(figures["closed_loop_poles"])
    yield ""
    if "delays" in figures:
        yield "Sensitivity, and steer for noise, per metre of it in the lateral error:"
        for at in figures["delays"]:
            yield f"  {_PER_MS * at['delay_s']:>3.0f} ms   {_noise_and_sensitivity(at)}"
    elif figures["margins"] is None:
        yield "NOT STABLE, even without delay:"
        yield f"  its slowest mode {_decay_in_words(figures['decay_1_s'])}"
    else:
        yield "Margins without delay, at the command on the bus:"
        yield from _margins(figures["margins"])
    yield ""
    yield "Constant delay between command and wheel angle:"
    yield from _delays(figures["stable_delays"])
    if figures.get("jitter"):
        yield ""
        yield (
            "A new latency for each command (gamma, newest wins,"
            f" {100.0 * figures['jitter'][0]['loss']:g} % lost), standard deviation:"
        )
        yield from _jitter(figures["jitter"])


def _corners(corners: Sequence[Figures]) -> Iterator[str]:
    if corners:
        yield ""
        searched_ms = _PER_MS * corners[0]["stable_delays"]["searched_s"]
        yield f"Delay margin at the corners of [validity], judged up to {searched_ms:g} ms:"
    for corner in corners:
        yield f"  {_margin(corner['stable_delays']):>14}  {in_words(corner['vehicle'])}"


def _fallback(fallback: Figures | None) -> Iterator[str]:
    if fallback is not None:
        yield f"{fallback['when']}, the law is {fallback['law']}, with a"
        yield from _delays(fallback["stable_delays"])
        yield "around the nominal plant. A heavier or a faster vehicle tolerates less delay; --law"
        yield f"{fallback['law']} --check analyses it."


def _noise_and_sensitivity(at: Figures) -> str:
    if at["peak_sensitivity"] is None:
        return f"NOT STABLE, its slowest mode {_decay_in_words(at['decay_1_s'])}"
    noise = f"{at['noise_gain_rad_m']:.4g} rad"
    return f"sensitivity at most {at['peak_sensitivity']:.4g}, {noise}"


def _poles(poles: Sequence[Figures]) -> Iterator[str]:
    shown = [pole for pole in poles if pole["modulus"] >= _MODULUS_SHOWN_MIN]
    if shown:
        yield f"  {'z':>24} {'|z|':>12} {'decay [1/s]':>14} {'omega [rad/s]':>18}"
    for pole in shown:
        real, imag = pole["real"], pole["imag"]
        z = f"{real:.6f} ± {imag:.6f}j" if imag else f"{real:.6f}"
        decay_1_s = round(pole["decay_1_s"], 4) + 0.0  # no "-0.0000"
        rates = f"{decay_1_s:>14.4f} {pole['omega_rad_s']:>18.4f}"
        yield f"  {z:>24} {pole['modulus']:>12.6f} {rates}"
    hidden = sum(1 + (pole["imag"] > 0.0) for pole in poles if pole["modulus"] < _MODULUS_SHOWN_MIN)
    if hidden:
        yield f"  {'and ' if shown else ''}{hidden} at z = 0"


def _decay_in_words(decay_1_s: float) -> str:
    if decay_1_s < -SLOWEST_DECAY_1_S:
        return f"grows at {-decay_1_s:.4g} 1/s"
    return f"neither decays nor grows (|rate| below {SLOWEST_DECAY_1_S:g} 1/s): the vehicle drifts"


def _margins(margins: Figures) -> Iterator[str]:
    yield (
        f"  gain         stable between x {margins['gain_min']:.4g} and x {margins['gain_max']:.4g}"
    )
    if math.isfinite(margins["phase_rad"]):
        phase_deg = math.degrees(margins["phase_rad"])
        yield (
            f"  phase        {margins['phase_rad']:.4g} rad ({phase_deg:.1f}°)"
            f" at {margins['crossover_rad_s']:.4g} rad/s"
        )
    yield (
        f"  sensitivity  at most {margins['peak_sensitivity']:.4g},"
        f" at {margins['peak_sensitivity_rad_s']:.4g} rad/s"
    )


def _delays(delays: Figures) -> Iterator[str]:
    limit_ms = round(_PER_MS * delays["searched_s"])
    yield f"  delay margin  {_margin(delays)}"
    ranges = [
        f"{in_ms(first, math.ceil)} to {in_ms(last, math.floor)} ms"
        for first, last in delays["intervals_s"]
    ]
    yield from _wrapped("  stable at     ", ranges or ["no delay"])
    yield f"                (searched from 0 to {limit_ms} ms)"


def _margin(delays: Figures) -> str:
    match delays["margin_s"]:
        case None:
            return f"above {round(_PER_MS * delays['searched_s'])} ms"
        case 0:
            return "none"
        case margin_s:
            return f"{in_ms(margin_s, math.floor)} ms"


def _jitter(means: Sequence[Figures]) -> Iterator[str]:
    for at in means:
        heading = f"  mean {_PER_MS * at['mean_s']:>3.0f} ms   "
        if at["not_analysed"]:
            yield f"{heading}{at['not_analysed']}"
            continue
        ranges = [
            f"{math.ceil(round(_PER_MS * first, 6))} to {math.floor(round(_PER_MS * last, 6))} ms"
            for first, last in at["spreads_s"]
        ]
        yield from _wrapped(heading, ranges or ["no standard deviation"])
    yield "                (mean-square stability, searched from 0 to the mean)"


def _wrapped(heading: str, ranges: Sequence[str]) -> Iterator[str]:
    for start in range(0, len(ranges), _RANGES_PER_LINE):
        line = ", ".join(ranges[start : start + _RANGES_PER_LINE])
        more = "," if start + _RANGES_PER_LINE < len(ranges) else ""
        yield f"{heading if start == 0 else ' ' * len(heading)}{line}{more}"
