"""Report of a design: its preset, the reasons for its values in words, and a picture.

A preset is settings below comments with what was measured. The picture has the RMS over the
delay.
"""

from collections.abc import Iterable, Iterator, Sequence
from math import inf

import numpy as np
from matplotlib.figure import Figure

from ...closed_loop.reports.plot_style import LINES
from ...controller.analysis.loop_signals import HEADING_NOISE_1_M
from ...controller.laws.law_from_settings import required
from ...controller.settings import ControllerSettings
from ...plant_emulator.network.settings import Order
from ...plant_emulator.path.settings import PathSettings
from ...runtime.node import NS_PER_MS
from ...runtime.settings import Settings
from ...runtime.settings.toml_text import dump_toml
from .demands import Demand
from .law_design import NUMBER_UNITS, Design, failure
from .predictor_design import PredictorDesign
from .road import roads_in_words
from .specification import ConditionsTable, Specification
from .vehicle_file import VehicleFile

_TITLES = {
    "pd": "PD",
    "pid": "PID",
    "pid_heading": "PID with a gain on the heading error",
    "pd_dob": "PD with disturbance observer",
    "pd_cdob": "PD with communication disturbance observer",
    "pd_ddob": "PD with double disturbance observer",
    "predictor": "Predictor",
    "packet": "Plans of commands",
}
_DEMAND_UNITS = {**NUMBER_UNITS, "condition": " m"}
_JUDGED_LAST = ("RMS error", "steer")
"""Of what is judged only where all else is nearly met."""
_NOISE_M = 0.02
_LABEL_WIDTH = 18
UNITS = {"k_p": "rad/m", "k_d": "rad s/m", "k_i": "rad/(m s)", "k_heading": "rad/rad"}
_CORNERS_NAMED_MAX = 4


def preset_text(
    spec: Specification,
    vehicle: VehicleFile,
    design: Design | PredictorDesign,
    sources: tuple[str, str],
) -> str:
    """Return the TOML of a preset; ``sources`` are the names of the vehicle's and spec's files.

    The supervision is left out: it has nothing to do with the design, and its defaults hold.
    """
    ranges = vehicle.uncertainty.given()
    if isinstance(design, PredictorDesign):
        delays = f"delay from 0 to {design.delays_ns[-1] / NS_PER_MS:g} ms, measured by the echo."
        law, ended = design.settings.law, design.ended
        points = required(spec.predictor).values_per_range
        judged = f"{points ** len(ranges)} vehicles"
        figures, settings = predictor_figures(spec, design), design.settings
    else:
        delays = f"constant delay from 0 to {spec.delay.ms_max:g} ms."
        law, judged = design.found.law, f"{len(vehicle.corners)} corners"
        ended, figures, settings = design.found.ended, _figures(spec, design), design.preset
    over = [f"{field} {low:.6g} to {high:.6g}" for field, (low, high) in ranges.items()]
    if isinstance(design, PredictorDesign) and spec.road is not None:
        judged, *over = roads_in_words(spec.road)
    head = [
        f"{_TITLES[law]} for {spec.rate_hz:g} Hz and any {delays}",
        f"Written by tools.design from {sources[0]} and {sources[1]}; do not edit.",
        *([] if ended else [STOPPED]),
        "",
        f"Errors of the car; worst of {judged} and, where none is given, of all delays:",
    ]
    head += [f"  {each}" for each in over]
    head += [f"  {path_in_words(path)}, {spec.course.duration_s:g} s" for path in spec.course.paths]
    return _commented(head, figures, settings)


def predictor_figures(spec: Specification, design: PredictorDesign) -> Iterator[tuple[str, str]]:
    """Yield a heading and a figure, line by line."""
    table = required(spec.predictor)
    delays_ms = [delay_ns // NS_PER_MS for delay_ns in design.delays_ns]
    roads = {"largest error": design.road_m, "no PATH_AHEAD": design.without_path_m}
    for label, errors_m in roads.items():
        for ms, (known_m, other_m) in zip(delays_ms, errors_m, strict=False):
            share = required(spec.road).off_share
            other = f"{other_m:.3f} m {100.0 * share:g} % heavier and softer"
            yield label, f"{known_m:.3f} m at {ms} ms, {other}"
    for ms, rms_m, settled_m in zip(delays_ms, design.rms_m, design.settled_rms_m, strict=True):
        yield (
            "RMS error",
            f"{settled_m:.4f} m at {ms} ms from {spec.ignore_s:g} s on,"
            f" {rms_m:.4f} m from the start",
        )
    yield from _jitters(spec, design.jitter_rms_m, "gamma, newest wins")
    noise_m, gain_rad_m = table.lateral_error_noise_m, design.noise_gain_rad_m
    yield (
        "noise gain",
        f"{gain_rad_m:.3g} rad/m, limit {spec.noise_gain_rad_m_max:g}: {1e2 * noise_m:g} cm and"
        f" {1e3 * HEADING_NOISE_1_M * noise_m:g} mrad are {gain_rad_m * noise_m:.2g} rad of steer",
    )
    peak = f"{design.peak_sensitivity:.3g}, limit {spec.peak_sensitivity_max:g}"
    yield "peak sensitivity", peak
    for met, largest_m in zip(table.conditions, design.conditions_m, strict=True):
        limit = f"limit {met.error_m_max:g}, at {conditions_in_words(met)}"
        yield "largest error", f"{largest_m:.2f} m, {limit}"
    yield (
        "without echoes",
        f"pd_ddob, stable up to a constant delay of {design.fallback_up_to_ns // NS_PER_MS} ms",
    )


def conditions_in_words(met: ConditionsTable) -> str:
    """Return the network and the steering of a demand."""
    words = [f"{met.mean_ms:g} ms"]
    if met.spread_ms > 0.0:
        words = [f"{met.mean_ms:g} ± {met.spread_ms:g} ms (gamma)"]
    if met.correlation_ms > 0.0:
        words.append(f"correlated over {met.correlation_ms:g} ms")
    if met.order is not Order.NEWEST_WINS:
        words.append(met.order.value.replace("_", " "))
    if met.loss > 0.0:
        burst = "" if met.burst_frames is None else f" in bursts of {met.burst_frames:g}"
        words.append(f"{100.0 * met.loss:g} % lost{burst}")
    if met.lag_ms > 0.0:
        words.append(f"an unknown steering lag of {met.lag_ms:g} ms")
    return ", ".join(words)


STOPPED = "The search was stopped before its end: this is the best so far, not the best."


def unmet_text(
    law: str, settings: ControllerSettings, demands: Sequence[Demand], sources: tuple[str, str]
) -> str:
    """Return the TOML of the best of a search whose demands are not met; its first line says so."""
    head = [
        f"NOT A DESIGN: this {law} fails demands of {sources[1]} for {sources[0]}.",
        "It is the best that the search found. What was demanded and reached:",
    ]
    return _commented([*head, "", *outcome_lines(demands)], [], settings)


def outcome_lines(demands: Sequence[Demand]) -> Iterator[str]:
    """Yield what was demanded against what was reached, a line for each demand."""
    for demand in demands:
        unit = _DEMAND_UNITS.get(demand.name.rstrip(" 0123456789"), "")
        if demand.limit:
            at_most = "" if demand.limit == inf else f", at most {demand.limit:g}{unit}"
            reached = f"{demand.value:.4g}{unit}{at_most}"
        else:
            reached = failure(demand) if demand.excess else ""
        verdict = "NOT MET" if demand.excess else "met"
        active = "  <- active" if demand.is_active and not demand.excess else ""
        yield f"  {demand.name:{_LABEL_WIDTH}}{verdict:9}{reached}{active}".rstrip()
    if not any(demand.name in _JUDGED_LAST for demand in demands):
        yield "  No other demand was judged, as these are too far from met."


def _commented(
    comments: Iterable[str], figures: Iterable[tuple[str, str]], settings: ControllerSettings
) -> str:
    lines = [*comments, "", *(f"  {label:{_LABEL_WIDTH}}{text}" for label, text in figures)]
    commented = "".join(f"# {line}".rstrip() + "\n" for line in lines)
    return commented + dump_toml(settings, _untouched(settings))


def _untouched(settings: ControllerSettings) -> list[str]:
    """Return the tables that a preset leaves out: all at their defaults, except the limits."""
    return [
        name
        for name, field in ControllerSettings.model_fields.items()
        if isinstance(field.default, Settings)
        and getattr(settings, name) == field.default
        and name != "limits"
    ]


def path_in_words(path: PathSettings) -> str:
    """Return a path with its measures."""
    measures = path.model_dump(mode="json")
    kind = str(measures.pop("kind")).replace("_", " ")
    return ", ".join([kind, *(f"{key} {value}" for key, value in measures.items())])


def measured(spec: Specification, design: Design) -> Iterator[tuple[str, str]]:
    """Yield a heading and a figure of what a law reaches, line by line."""
    worst_m = design.rms_m.max(axis=0)
    last = design.rms_delays_ns.index(spec.delays_ns[-1])
    rms = f"{worst_m[0]:.4f} m at 0 ms, {worst_m[last]:.4f} m at {spec.delay.ms_max:g} ms"
    yield "RMS error", f"{rms}, from {spec.ignore_s:g} s on"
    if design.rms_held_up_to_ns is not None:
        held_ms = design.rms_held_up_to_ns // NS_PER_MS
        yield "", f"at most {spec.rms_m_max_of(design.found.law):g} m up to {held_ms} ms"
    yield from _jitters(spec, design.jitter_rms_m, "gamma, newest wins; virtual time")
    confirmation = required(design.found.confirmation)
    yield "stable", f"up to {confirmation.stable_up_to_ns // NS_PER_MS} ms"
    if spec.actuator is not None and confirmation.with_lag_up_to_ns is not None:
        lag_ms = confirmation.with_lag_up_to_ns // NS_PER_MS
        lag = f"a steering actuator lag of {spec.actuator.lag_s:g} s"
        yield "", f"up to {lag_ms} ms behind {lag}"
    yield "settling", f"no mode decays more slowly than {confirmation.decay_1_s:.3g} 1/s"


def _figures(spec: Specification, design: Design) -> Iterator[tuple[str, str]]:
    demands = {demand.name: demand for demand in design.found.judgement.demands}
    yield from measured(spec, design)
    yield "peak sensitivity", _limited(demands["peak sensitivity"], "")
    noise = demands["noise gain"]
    yield "noise gain", _limited(noise, " rad/m")
    yield "", f"{1e2 * _NOISE_M:g} cm of white noise: {_NOISE_M * noise.value:.2g} rad of steer"
    yield "largest steer", _limited(demands["steer"], " rad")


def _jitters(spec: Specification, rms_m: Sequence[float], how: str) -> Iterator[tuple[str, str]]:
    for table, value_m in zip(spec.jitter, rms_m, strict=True):
        at = f"{table.mean_ms:g} ± {table.spread_ms:g} ms, {100.0 * table.loss:g} % lost"
        yield "jitter", f"{value_m:.4f} m at {at} ({how})"


def _limited(demand: Demand, unit: str) -> str:
    return f"{demand.value:.3g}{unit}, limit {demand.limit:g}"


def draw_design(spec: Specification, vehicle: VehicleFile, design: Design) -> Figure:
    """Draw the RMS over the delay, a curve for each corner."""
    figure = Figure(figsize=(8.0, 4.8))
    axes = figure.subplots()
    delay_ms = np.array(design.rms_delays_ns) / NS_PER_MS
    for line, label, rms_m in zip(LINES(), _labels(vehicle), design.rms_m, strict=False):
        axes.plot(delay_ms, 1e3 * rms_m, **line, label=label)
    largest_m = spec.rms_m_max_of(design.found.law)
    inside = delay_ms <= spec.delay.ms_max
    highest_mm = 1e3 * max(float(design.rms_m[:, inside].max()), largest_m or 0.0)
    if largest_m is not None:
        axes.axhline(1e3 * largest_m, color="black", lw=0.9, ls="--", label="limit")
    axes.axvspan(0.0, spec.delay.ms_max, color="0.93", zorder=0.0)
    axes.set(xlabel="constant delay [ms]", ylabel="RMS of the car [mm]")
    axes.set(ylim=(0.0, 1.5 * highest_mm), xlim=(0.0, delay_ms[-1]))
    values = ", ".join(f"{key} {value:g}" for key, value in design.found.values.items())
    axes.set_title(f"{spec.name}_{design.found.law}: {values}", fontsize=10)
    axes.legend(fontsize=8)
    return figure


def _labels(vehicle: VehicleFile) -> list[str | None]:
    """Return a label that identifies a corner; empty where there are too many."""
    corners = vehicle.corners
    if len(corners) > _CORNERS_NAMED_MAX:
        return [None] * len(corners)
    fields = list(vehicle.uncertainty.given())
    labels = (", ".join(f"{name} {getattr(one, name):.4g}" for name in fields) for one in corners)
    return [label or "nominal" for label in labels]
