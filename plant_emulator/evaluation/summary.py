"""What a plant's report says about its run, in a few lines, each with its heading."""

from collections.abc import Iterator, Mapping
from typing import Any

from ...runtime.program.report import causes_line, durations_line


def plant_summary(node: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Return the lines for the user; ``node`` is what the plant itself reports."""
    for point, name in (("preview point", "lateral_error"), ("centre of gravity", "cg_deviation")):
        yield (
            point,
            f"off the path RMS {1e3 * node[f'{name}_rms_m']:.2f} mm, "
            f"peak {1e3 * node[f'{name}_peak_m']:.2f} mm over {node['motion_s']:.2f} s"
            if node["samples"]
            else "unknown: the vehicle has not moved",
        )
    for heading, line in (("commands", node["downlink"]), ("measurements", node["uplink"])):
        yield heading, f"latency {durations_line(line['latency'])}, {line['lost']} lost"
    safety = node["safety"]
    if safety["holdings"]:
        yield "holds", f"{safety['holdings']}, of which {safety['fallbacks']} to the fallback"
    if safety["interventions"]:
        yield "limited", f"commands by {causes_line(safety['interventions'])}"
    if node["rejected"]:
        yield "plant rejected", causes_line(node["rejected"])
