"""The quantities of a run of the controller that ``--fail-if`` may name, read from its report."""

from collections.abc import Mapping

from ...runtime.program.fail_if_conditions import Quantity, Report
from ..node.run_figures import ControlVerdict


def _number(key: str) -> Quantity:
    return Quantity(lambda report: float(report["node"][key]))


def _worked(key: str) -> Quantity:
    """Return a figure that exists only if the law has run."""
    return Quantity(lambda report: report["node"][key] if report["node"]["active_share"] else None)


def _round_trip(report: Report) -> float | None:
    durations = report["node"]["round_trip"]
    return float(durations["p99_s"]) if durations["samples"] else None


_WORKED = ("measured_rms_m", "measured_peak_m", "limited_share", "peak_steer_rad")
QUANTITIES: Mapping[str, Quantity] = {
    "verdict": Quantity(lambda report: str(report["node"]["verdict"]), tuple(ControlVerdict)),
    "no_effect_s": _number("no_effect_s"),
    "active_share": _number("active_share"),
    **{key: _worked(key) for key in _WORKED},
    "round_trip_p99_s": Quantity(_round_trip),
    "holds": _number("holds"),
}
