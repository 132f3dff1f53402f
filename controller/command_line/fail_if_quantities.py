"""The quantities of a run of the controller that ``--fail-if`` may name, read from its report."""

from collections.abc import Mapping
from types import MappingProxyType

from ...runtime.program.fail_if_conditions import Quantity, Report
from ..node.run_figures import ControlVerdict


def _worked(key: str) -> Quantity:
    """Return a figure that exists only if the law has run."""

    def read(report: Report) -> float | None:
        node = report["node"]
        value: float | None = node[key] if node["active_share"] else None
        return value

    return Quantity(read)


def _round_trip(report: Report) -> float | None:
    durations = report["node"]["round_trip"]
    value: float | None = durations["p99_s"] if durations["samples"] else None
    return value


QUANTITIES: Mapping[str, Quantity] = MappingProxyType(
    {
        "verdict": Quantity(lambda report: str(report["node"]["verdict"]), tuple(ControlVerdict)),
        "no_effect_s": Quantity(lambda report: float(report["node"]["no_effect_s"])),
        "active_share": Quantity(lambda report: float(report["node"]["active_share"])),
        "measured_rms_m": _worked("measured_rms_m"),
        "measured_peak_m": _worked("measured_peak_m"),
        "limited_share": _worked("limited_share"),
        "peak_steer_rad": _worked("peak_steer_rad"),
        "round_trip_p99_s": Quantity(_round_trip),
        "holds": Quantity(lambda report: float(report["node"]["holds"])),
    }
)
