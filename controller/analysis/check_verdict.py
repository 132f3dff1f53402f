"""The verdict of ``--check`` and what ``--fail-if`` may name of it."""

import math
from collections.abc import Mapping
from enum import StrEnum
from operator import itemgetter
from types import MappingProxyType
from typing import Any, NamedTuple

from ...runtime.thresholds import Quantity


class CheckVerdict(StrEnum):
    """The verdict on the loop around the nominal plant and the corners of [validity]."""

    STABLE = "stable"
    NOT_STABLE = "not stable"
    NOT_ANALYSED = "not analysed"


class Found(NamedTuple):
    """What the analysis found.

    ``where``           around what the margin was found
    ``delay_margin_s``  where stability is first lost, 0 if the loop is not stable without delay,
                        infinite beyond the search; None where there is no analysis
    """

    verdict: CheckVerdict
    delay_margin_s: float | None
    where: str = "around the nominal plant"

    def __str__(self) -> str:
        """Return verdict and reason."""
        match self.delay_margin_s:
            case None:
                reason = "see above for the reason"
            case 0.0:
                reason = f"{self.where}, even without delay"
            case math.inf:
                reason = f"{self.where}, at every constant delay of the search"
            case margin_s:
                reason = f"{self.where}, up to a delay of {1e3 * margin_s:.2f} ms"
        return f"{self.verdict}: {reason}"


NOT_ANALYSED = Found(CheckVerdict.NOT_ANALYSED, None)
QUANTITIES: Mapping[str, Quantity] = MappingProxyType(
    {
        "verdict": Quantity(lambda report: str(report["verdict"]), tuple(CheckVerdict)),
        "delay_margin_s": Quantity(lambda report: report["delay_margin_s"]),
    }
)
"""What ``--fail-if`` may name, read from ``Found``."""


def found_in(figures: Mapping[str, Any]) -> Found:
    """Return the verdict on the figures of ``check_figures``."""
    stable = figures.get("stable_delays")
    if stable is None:
        return NOT_ANALYSED
    nominal = Found._field_defaults["where"]
    margins_s = {nominal: stable["margin_s"]}
    for corner in figures["corners"]:
        margins_s[f"at {in_words(corner['vehicle'])}"] = corner["stable_delays"]["margin_s"]
    bounds_s = {where: margin_s for where, margin_s in margins_s.items() if margin_s is not None}
    if not bounds_s:
        beside = " and all corners" if figures["corners"] else ""
        return Found(CheckVerdict.STABLE, math.inf, f"{nominal}{beside}")
    where, margin_s = min(bounds_s.items(), key=itemgetter(1))
    verdict = CheckVerdict.STABLE if margin_s > 0.0 else CheckVerdict.NOT_STABLE
    return Found(verdict, margin_s, where)


def in_words(vehicle: Mapping[str, float]) -> str:
    """Return the parameters of a corner."""
    return ", ".join(f"{key} = {value:.4g}" for key, value in vehicle.items())
