"""The quantities of a run of the plant that ``--fail-if`` may name, read from its report."""

from collections.abc import Mapping

from ...runtime.program.fail_if_conditions import Quantity, Report
from ..evaluation.run_verdict import Verdict


def _driven(key: str) -> Quantity:
    """Return a figure that exists only if the vehicle has moved."""
    return Quantity(lambda report: report["node"][key] if report["node"]["samples"] else None)


def _outside(report: Report) -> float | None:
    """Return how far the body was beyond an edge of its corridor; None without one."""
    corridor = report["node"]["corridor"]
    return None if corridor is None else float(corridor["outside_m"])


def _verdict(report: Report) -> str | None:
    """Return the verdict; None for a log that is not judged."""
    verdict = report["node"]["verdict"]
    return None if verdict is None else str(verdict)


def _warnings(report: Report) -> int:
    node = report["node"]
    return len(node["warnings"]) + bool(node["second_senders"])


QUANTITIES: Mapping[str, Quantity] = {
    "verdict": Quantity(_verdict, tuple(Verdict)),
    "rms_m": _driven("rms_m"),
    "settled_rms_m": _driven("settled_rms_m"),
    "peak_m": _driven("peak_m"),
    "preview_rms_m": _driven("preview_rms_m"),
    "preview_peak_m": _driven("preview_peak_m"),
    "settled_peak_m": _driven("settled_peak_m"),
    "outside_m": Quantity(_outside),
    "beyond_lane_m": Quantity(lambda report: report["node"].get("beyond_lane_m")),
    "final_m": _driven("final_m"),
    "settling_s": _driven("settling_s"),
    "wheel_angle_peak_rad": _driven("wheel_angle_peak_rad"),
    "limited_share": _driven("limited_share"),
}
"""Those that a recording of the bus has too."""
RUN_QUANTITIES: Mapping[str, Quantity] = {**QUANTITIES, "warnings": Quantity(_warnings)}
