"""Summary, verdict and warnings of a controller's report, in words."""

from collections.abc import Iterator, Mapping
from typing import Any

from ...dbc.codec.sender_watch import second_sender_line
from ...dbc.messages import Validity
from ...runtime.node import NS_PER_S
from ...runtime.program.fail_if_conditions import Report
from ...runtime.program.report import causes_line, durations_line
from ..limits.designed_ranges import VALIDITY_IN_WORDS
from ..settings import ControllerSettings
from .run_figures import ControlVerdict


def controller_summary(node: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Return the lines for the user; ``node`` is what the controller itself reports."""
    yield "law", f"{node['law']} at {node['rate_hz']:g} Hz"
    yield "steer", f"peak {node['peak_steer_rad']:.4f} rad"
    yield "round trip", durations_line(node["round_trip"])
    if node["holds"]:
        lasted = ", ".join(
            f"{node['mode_s'][mode]:.2f} s {mode.upper()}" for mode in ("holding", "safe_stop")
        )
        yield "holds", f"{node['holds']}, {lasted}"
    for state in ("speed_low", "speed_high", "delay_long"):
        if share := node["validity_share"].get(state):
            text = (
                f"{state.replace('_', ' too ')} for the settings, {100.0 * share:.0f} % of the time"
            )
            yield "validity", text
    if share := node["validity_share"].get("model_misfit"):
        text = VALIDITY_IN_WORDS[Validity.MODEL_MISFIT]
        yield "warning", f"{text}, {100.0 * share:.0f} % of the time"
    period = node["sensor_period"]
    if period is not None and period["times_wrong"]:
        yield (
            "warning",
            f"the plant's sensor period was about {1e3 * period['measured_s']:.3g} ms, but "
            f"link.sensor_period_ms = {1e3 * period['setting_s']:g}: the law did without the delay",
        )
    if node["contradiction"]:
        yield "warning", f"signals of the plant: {node['contradiction']}"
    if node["second_senders"]:
        yield "warning", second_sender_line(node["second_senders"])
    if node["rejected"]:
        yield "controller rejected", causes_line(node["rejected"])


def verdict_text(report: Report) -> str:
    """Return the verdict with the figures that explain it, and who else has sent."""
    node = report["node"]
    return "; ".join(filter(None, (_judged(node), second_sender_line(node["second_senders"]))))


def _judged(node: Report) -> str:
    verdict = ControlVerdict(node["verdict"])
    if verdict is ControlVerdict.NO_START:
        return f"{verdict}: no measurement ever arrived"
    if verdict is ControlVerdict.NO_EFFECT:
        sent, ago_s = node["commands_sent"], node["no_effect_s"]
        if not node["in_effect"]:
            return f"{verdict}: none of its {sent} commands took effect, by the plant's echoes"
        return f"{verdict} at the end: the last command that took effect was {ago_s:.2f} s before"
    did = "could steer" if "driver" in node else "steered"  # a driver may have, in its place
    text = (
        f"{verdict} at the end; the law {did} for {100.0 * node['active_share']:.4g} % of the"
        f" time; measured error RMS {1e3 * node['measured_rms_m']:.1f} mm,"
        f" peak {1e3 * node['measured_peak_m']:.1f} mm"
    )
    return "; ".join(filter(None, (text, limited_text(node))))


def limited_text(node: Report) -> str:
    """Return what share of the law's commands ``[limits]`` changed; empty for none."""
    if not node["limited_share_by"]:
        return ""
    limits = (f"{name} {100.0 * share:.3g} %" for name, share in node["limited_share_by"].items())
    share = f"{100.0 * node['limited_share']:.3g} %"
    return f"the controller's [limits] changed {share} of the law's commands ({', '.join(limits)})"


def rare_measurements(settings: ControllerSettings, node: Mapping[str, Any]) -> str:
    """Return the warning of ``sparse_measurements`` about what a run has measured, else ""."""
    age_s = node["sample_age"]["mean_s"]
    # With a measurement at every tick the newest is never older than a period; with fewer it is
    # half a sensor period old on average.
    is_rare = age_s * settings.rate_hz > 1.5
    return sparse_measurements(settings, 2.0 * age_s) if is_rare else ""


def sparse_measurements(settings: ControllerSettings, sensor_period_s: float) -> str:
    """Return a warning where the law differentiates measurements rarer than its ticks, else "".

    An unfiltered derivative then acts in the first tick after each measurement only. The paper's
    presets are such laws at 1 kHz.
    """
    period_s, pd = settings.period_ns / NS_PER_S, settings.pd
    is_ideal = pd is not None and pd.derivative_filter_rad_s is None
    if not is_ideal or sensor_period_s < 1.5 * period_s:
        return ""
    return (
        f"measurements about every {1e3 * sensor_period_s:.3g} ms for a control period of"
        f" {1e3 * period_s:.3g} ms make this another law, as its derivative has no filter; set the"
        f" plant's sensor_period_ms = {1e3 * period_s:.3g}"
    )
