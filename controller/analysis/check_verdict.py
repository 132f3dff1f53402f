"""The verdict of ``--check`` and what ``--fail-if`` may name of it."""

import math
from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Any, NamedTuple

from ...runtime.thresholds import Quantity


class CheckVerdict(StrEnum):
    """The verdict on the loop around the nominal plant."""

    STABLE = "stable"
    NOT_STABLE = "not stable"
    NOT_ANALYSED = "not analysed"


class Found(NamedTuple):
    """What the analysis found.

    ``delay_margin_s``  where stability is first lost, 0 if the loop is not stable without delay,
                        infinite beyond the search; None where there is no analysis
    """

    verdict: CheckVerdict
    delay_margin_s: float | None

    def __str__(self) -> str:
        """Return verdict and reason."""
        match self.delay_margin_s:
            case None:
                reason = "see above for the reason"
            case 0.0:
                reason = "around the nominal plant, even without delay"
            case math.inf:
                reason = "around the nominal plant, at every constant delay of the search"
            case margin_s:
                reason = f"around the nominal plant, up to a delay of {1e3 * margin_s:.2f} ms"
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
    margin_s = stable["margin_s"]
    if margin_s == 0.0:
        return Found(CheckVerdict.NOT_STABLE, 0.0)
    return Found(CheckVerdict.STABLE, math.inf if margin_s is None else margin_s)
