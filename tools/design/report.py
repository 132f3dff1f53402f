"""The preset that a design is written as: settings, below comments with what was measured."""

from collections.abc import Iterable, Iterator, Sequence

from ...controller.settings import ControllerSettings
from ...plant_emulator.network.settings import Order
from ...plant_emulator.path.settings import PathSettings
from ...runtime.node import NS_PER_MS
from ...runtime.settings import Settings
from ...runtime.settings.toml_text import dump_toml
from .design import Design
from .judgement import Demand
from .predictor import PredictorDesign
from .specification import ConditionsTable, PredictorTable, Specification
from .vehicle_file import VehicleFile

_TITLES = {
    "pd": "PD",
    "pd_dob": "PD with disturbance observer",
    "pd_cdob": "PD with communication disturbance observer",
    "pd_ddob": "PD with double disturbance observer",
    "predictor": "Predictor",
}
_NOISE_M = 0.02
_LABEL_WIDTH = 18


def preset_name(spec: Specification, law: str) -> str:
    """Return what the preset of a law is called."""
    return f"{spec.name}_{law}"


def preset_text(
    spec: Specification, vehicle: VehicleFile, design: Design, sources: tuple[str, str]
) -> str:
    """Return the TOML of a preset; ``sources`` are the names of the vehicle's and spec's files.

    The supervision is left out: it has nothing to do with the design, and its defaults hold.
    """
    delays = f"constant delay from 0 to {spec.delay.ms_max:g} ms."
    judged = f"{len(vehicle.box.vertices())} corners"
    head = _head(spec, vehicle, design.law, delays, judged, sources)
    return _commented(head, _figures(spec, design), design.settings)


def predictor_preset_text(
    spec: Specification,
    table: PredictorTable,
    vehicle: VehicleFile,
    design: PredictorDesign,
    sources: tuple[str, str],
) -> str:
    """Return the TOML of a predictor's preset."""
    delays = f"delay from 0 to {table.delay_ms_max:g} ms, measured by the echo."
    judged = f"{design.vehicles} vehicles"
    head = _head(spec, vehicle, "predictor", delays, judged, sources)
    return _commented(head, predictor_figures(spec, table, design), design.settings)


def _head(
    spec: Specification,
    vehicle: VehicleFile,
    law: str,
    delays: str,
    judged: str,
    sources: tuple[str, str],
) -> Iterator[str]:
    yield f"{_TITLES[law]} for {spec.rate_hz:g} Hz and any {delays}"
    yield f"Written by tools.design from {sources[0]} and {sources[1]}; do not edit."
    yield ""
    yield f"Worst of {judged} and, where none is given, of all delays:"
    for field, minimum, maximum in vehicle.box.ranges:
        yield f"  {field} {minimum:.6g} to {maximum:.6g}"
    for path in spec.course.paths:
        yield f"  {path_in_words(path)}, {spec.course.duration_s:g} s"


def predictor_figures(
    spec: Specification, table: PredictorTable, design: PredictorDesign
) -> Iterator[tuple[str, str]]:
    """Yield a heading and a figure, line by line."""
    for ns, rms_m, settled_m in zip(
        design.delays_ns, design.rms_m, design.settled_rms_m, strict=True
    ):
        yield (
            "RMS error",
            f"{settled_m:.4f} m at {ns // NS_PER_MS} ms from {table.ignore_s:g} s on,"
            f" {rms_m:.4f} m from the start",
        )
    yield from _jitters(spec, design.jitter_rms_m, "gamma, newest wins")
    yield (
        "noise",
        f"{1e2 * table.lateral_error_noise_m:g} cm add {design.steer_noise_rad:.2g} rad of steer,"
        f" limit {table.steer_noise_rad_max:g}",
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
    kind, *measures = path.model_dump(mode="json").items()
    words = [str(kind[1]).replace("_", " "), *(f"{key} {value}" for key, value in measures)]
    return ", ".join(words)


def _figures(spec: Specification, design: Design) -> Iterator[tuple[str, str]]:
    demands = {demand.name: demand for demand in design.found.judgement.demands}
    worst_m = design.rms.rms_m.max(axis=0)
    last = design.rms.delays_ns.index(spec.delays_ns[-1])
    rms = f"{worst_m[0]:.4f} m at 0 ms, {worst_m[last]:.4f} m at {spec.delay.ms_max:g} ms"
    yield "RMS error", rms
    if design.rms_held_up_to_ns is not None:
        held_ms = design.rms_held_up_to_ns // NS_PER_MS
        yield "", f"at most {spec.rms_m_max_of(design.law):g} m up to {held_ms} ms"
    yield from _jitters(spec, design.jitter_rms_m, "gamma, newest wins; virtual time")
    confirmation = design.found.confirmation
    if confirmation is not None:
        yield "stable", f"up to {confirmation.stable_up_to_ns // NS_PER_MS} ms"
        if spec.actuator is not None and confirmation.with_lag_up_to_ns is not None:
            lag_ms = confirmation.with_lag_up_to_ns // NS_PER_MS
            lag = f"a steering actuator lag of {spec.actuator.lag_s:g} s"
            yield "", f"up to {lag_ms} ms behind {lag}"
        yield "settling", f"no mode decays more slowly than {confirmation.decay_1_s:.3g} 1/s"
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
