"""What a controller's report says about its run, in a few lines, each with its heading."""

from collections.abc import Iterator, Mapping
from typing import Any

from ...runtime.program.report import causes_line, durations_line


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
    if node["rejected"]:
        yield "controller rejected", causes_line(node["rejected"])
