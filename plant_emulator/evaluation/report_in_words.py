"""The plant's report in words: the verdict on its run, and a few lines of figures."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from ...dbc.codec.sender_watch import second_sender_line
from ...runtime.program.report import causes_line, durations_line
from .run_verdict import RANGE_M, SHORTEST_RUN_S, Verdict

Report = Mapping[str, Any]
_INTERVENTIONS_SHOWN = 10


def plant_summary(node: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Return the lines for the user; ``node`` is what the plant itself reports."""
    for point, name in (("car", ""), ("preview point", "preview_")):
        yield (
            point,
            f"off the path RMS {1e3 * node[f'{name}rms_m']:.2f} mm, "
            f"peak {1e3 * node[f'{name}peak_m']:.2f} mm over {node['motion_s']:.2f} s"
            if node["samples"]
            else "unknown: the vehicle has not moved",
        )
    if node["settled_rms_m"] is not None:
        settled = f"RMS {1e3 * node['settled_rms_m']:.2f} mm from {node['settled_s']:g} s on"
        yield "car, settled", f"off the path {settled}"
    for heading, line in (("commands", node["downlink"]), ("measurements", node["uplink"])):
        yield heading, f"latency {durations_line(line['latency'])}, {line['lost']} lost"
    for fault in node.get("faults", ()):
        what = " of ".join(filter(None, (fault["kind"], fault["message"])))
        yield "fault", f"{what}, {fault['direction']}, frames: {fault['changed']}"
    safety = node["safety"]
    if safety["holdings"]:
        yield (
            "steering holds",
            f"{safety['holdings']}, of which {safety['fallbacks']} to the fallback",
        )
    if safety["interventions"]:
        yield "limited", f"commands by {causes_line(safety['interventions'])}"
    if node["slowest_asked_m_s"] is not None:
        yield "speed", f"the controller asked to slow down to {node['slowest_asked_m_s']:.1f} m/s"
    made = node["interventions"]
    for index, each in enumerate(made["kept"][:_INTERVENTIONS_SHOWN]):
        yield f"intervention {index + 1}", each["text"]
    if made["count"] > _INTERVENTIONS_SHOWN:
        yield "interventions", f"{made['count']} in all over the bus; the report lists them"
    for warning in node["warnings"]:
        yield "warning", warning
    if node["second_senders"]:
        yield "warning", second_sender_line(node["second_senders"])
    if node["rejected"]:
        yield "plant rejected", causes_line(node["rejected"])


def verdict_text(node: Report) -> str:
    """Return a plant's verdict and its reason, the grip, what was limited, and who else sent."""
    verdict = Verdict(node["verdict"])
    parts = [f"{verdict}: {_REASONS[verdict](node)}"]
    if used_up := grip_text(node.get("grip_used")):
        parts.append(used_up)
    if node.get("stands"):  # a bus that is still watched does not tell
        parts.append("the car did not go forward at the end")
    if node["limited_share_by"]:
        limited = ", ".join(
            f"{name.replace('_', ' ')} {_percent(s)}"
            for name, s in node["limited_share_by"].items()
        )
        share = _percent(node["limited_share"])
        parts.append(f"the plant's steering limited for {share} of the time ({limited})")
    if node.get("second_senders"):  # a log alone has none
        parts.append(second_sender_line(node["second_senders"]))
    return "; ".join(parts)


def grip_text(grip_used: Report | None) -> str:
    """Return one sentence that names the grip; empty where there was some.

    ``grip_used``  as in the plant's report
    """
    if grip_used is None:
        return ""
    axles = "; ".join(
        f"{axle} {_percent(used['share'])} of the time, first at {used['from_s']:.2f} s"
        for axle in ("front", "rear")
        if (used := grip_used.get(axle))
    )
    left = f"left its {grip_used['left']} at {grip_used['left_s']:.2f} s"
    return f"before the car {left}, its tyres had used up their grip ({axles})"


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def _millimetres(value_m: float) -> str:
    return f"{1e3 * value_m:.1f} mm" if abs(value_m) < 1.0 else f"{value_m:.2f} m"


def _swings(node: Report) -> str:
    windows = node["windows"]
    omega_rad_s = windows["oscillation_rad_s"]
    rhythm = "" if omega_rad_s is None else f" at {omega_rad_s:.3g} rad/s"
    return f"swings of ±{_millimetres(windows['amplitude_m'])}{rhythm}"


def _wheel(node: Report) -> str:
    windows = node["windows"]
    if windows["wheel_amplitude_rad"] is None:
        return ""
    omega_rad_s = windows["wheel_oscillation_rad_s"]
    rhythm = "" if omega_rad_s is None else f" at {omega_rad_s:.3g} rad/s"
    return f", the wheel's of ±{windows['wheel_amplitude_rad']:.3g} rad{rhythm}"


def _shakes(node: Report) -> str:
    amplitude_rad = node["windows"]["wheel_amplitude_rad"]
    return f"the wheel swings by ±{amplitude_rad:.3g} rad in its fast motion; {_at_the_end(node)}"


def _drifts(node: Report) -> str:
    windows = node["windows"]
    return (
        f"{_point(node)} {_millimetres(abs(windows['mean_m']))} off on average, and leaving at "
        f"{_millimetres(abs(windows['drift_m_s']))}/s"
    )


def _at_the_end(node: Report) -> str:
    windows, peak_m = node["windows"], node["judged_peak_m"]
    return (
        f"{_point(node)} at most {_millimetres(windows['end_peak_m'])} off in the last "
        f"{windows['window_s']:.3g} s, {_millimetres(peak_m)} in the whole run"
    )


def _off(node: Report) -> str:
    swings = f", {_swings(node)}" if node["windows"]["amplitude_m"] is not None else ""
    return f"{_at_the_end(node)}{swings}"


def _point(node: Report) -> str:
    return _POINTS[node["judged_point"]]


def _left(node: Report) -> str:
    peak, settled_s = _millimetres(node["settled_peak_m"]), node["settled_s"]
    return f"{_point(node)} up to {peak} off after {settled_s:g} s, though back at the end"


def _beyond(node: Report) -> str:
    if node.get("beyond_lane_m") is None:
        return f"the error reached {_millimetres(node['judged_peak_m'])}"
    return f"a corner of the body left the lane by {_millimetres(node['beyond_lane_m'])}"


def _in_corridor(node: Report) -> str:
    where = node["corridor"]
    return f"{where['at_m']:.1f} m (section {where['section']})"


def _within(node: Report) -> str:
    if node["corridor"] is None:
        return ""
    free = _millimetres(-node["corridor"]["outside_m"])
    return f"; the body within the corridor by {free} or more, least at {_in_corridor(node)}"


def _nothing_arrived(node: Report) -> str:
    uplink = node.get("uplink")  # a log alone has none
    if uplink and uplink["pushed"] and not uplink["released"]:
        return "no measurement ever reached the controller"
    return "no command ever reached the actuator"


_POINTS = {"preview": "preview point", "centre_of_gravity": "car", "rear_axle": "rear axle"}
_REASONS: Mapping[Verdict, Callable[[Report], str]] = {
    Verdict.NO_START: _nothing_arrived,
    Verdict.TOO_SHORT: lambda _node: (
        f"a run of less than {SHORTEST_RUN_S:g} s shows nothing; let it last longer"
    ),
    Verdict.LEFT_RANGE: lambda _node: (
        f"the error exceeded ±{RANGE_M:.4g} m, or the car left its path"
    ),
    Verdict.LEFT_CORRIDOR: lambda node: (
        f"the body left the corridor at {_in_corridor(node)} by"
        f" {_millimetres(node['corridor']['outside_m'])}"
    ),
    Verdict.UNSTABLE: lambda node: f"{_swings(node)} that grow{_wheel(node)}",
    Verdict.LIMIT_CYCLE: lambda node: f"{_swings(node)} that last{_wheel(node)}",
    Verdict.DRIFTS: _drifts,
    Verdict.LEFT_ROAD: _beyond,
    Verdict.DECAYS: lambda node: f"{_off(node)}; less than before, too late",
    Verdict.OFF_PATH: _off,
    Verdict.LEFT_PATH: _left,
    Verdict.WHEEL_SHAKES: _shakes,
    Verdict.HOLDS: lambda node: f"{_at_the_end(node)}{_within(node)}",
}
