"""The verdict of ``--check`` and what ``--fail-if`` may name of it."""

import math
from collections.abc import Callable, Mapping
from enum import StrEnum
from operator import itemgetter
from typing import Any, NamedTuple

from ...runtime.program.fail_if_conditions import Quantity

_PER_MS = 1e3
_RESOLUTION = 100.0
"""Delays are shown in hundredths of a millisecond."""


class CheckVerdict(StrEnum):
    """The verdict on the loop around the nominal plant and the corners of [validity]."""

    STABLE = "stable"
    NOT_STABLE = "not stable"
    NOT_ANALYSED = "not analysed"


class Found(NamedTuple):
    """What the analysis found.

    ``delay_margin_s``  where stability is first lost, 0 if the loop is not stable without delay,
                        infinite beyond the search; None where there is no analysis
    ``reason``          with which vehicle the margin was found, in words
    """

    verdict: CheckVerdict
    delay_margin_s: float | None
    reason: str

    def __str__(self) -> str:
        """Return verdict and reason."""
        return f"{self.verdict}: {self.reason}"


NOT_ANALYSED = Found(CheckVerdict.NOT_ANALYSED, None, "see below for the reason")
QUANTITIES: Mapping[str, Quantity] = {
    "verdict": Quantity(lambda report: str(report["verdict"]), tuple(CheckVerdict)),
    "delay_margin_s": Quantity(lambda report: report["delay_margin_s"]),
}
"""What ``--fail-if`` may name, read from ``Found``."""


def found_in(figures: Mapping[str, Any]) -> Found:
    """Return the verdict on the figures of ``check_figures``.

    A loop is stable if it is so at every constant delay from 0 to that of [validity].
    """
    if "stable_delays" not in figures:
        return NOT_ANALYSED
    judged = {"around the nominal plant": figures["stable_delays"]}
    for corner in figures["corners"]:
        judged[f"at {in_words(corner['vehicle'])}"] = corner["stable_delays"]
    margins_s = {where: delays["margin_s"] for where, delays in judged.items()}
    bounds_s = {where: margin_s for where, margin_s in margins_s.items() if margin_s is not None}
    declared_s = figures["delay_max_s"] or 0.0
    if bounds_s:
        return _lost(*min(bounds_s.items(), key=itemgetter(1)), declared_s)
    searched_s = max(delays["searched_s"] for delays in judged.values())
    if searched_s < declared_s:
        reason = f"above {1e3 * searched_s:g} ms, {_declares(declared_s)}"
        return Found(CheckVerdict.NOT_ANALYSED, math.inf, reason)
    corners = " and all corners" if figures["corners"] else ""
    reason = f"around the nominal plant{corners}, at every constant delay of the search"
    return Found(CheckVerdict.STABLE, math.inf, reason)


def _lost(where: str, margin_s: float, declared_s: float) -> Found:
    if margin_s == 0.0:
        return Found(CheckVerdict.NOT_STABLE, margin_s, f"{where}, even without delay")
    margin = f"{in_ms(margin_s, math.floor)} ms"
    if margin_s < declared_s:
        reason = f"{where}, above {margin}, {_declares(declared_s)}"
        return Found(CheckVerdict.NOT_STABLE, margin_s, reason)
    return Found(CheckVerdict.STABLE, margin_s, f"{where}, up to a delay of {margin}")


def _declares(declared_s: float) -> str:
    return f"while [validity] declares {1e3 * declared_s:g} ms"


def in_words(vehicle: Mapping[str, float]) -> str:
    """Return the parameters of a corner."""
    return ", ".join(f"{key} = {value:.4g}" for key, value in vehicle.items())


def in_ms(time_s: float, rounded: Callable[[float], int]) -> str:
    """Return a time in hundredths of a millisecond, which a nanosecond more does not change."""
    return f"{rounded(round(_PER_MS * _RESOLUTION * time_s, 4)) / _RESOLUTION:.2f}"
