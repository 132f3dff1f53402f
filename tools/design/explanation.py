"""Explains each value: the demands that limit it, and the effect of changing it."""

from collections.abc import Iterator
from typing import NamedTuple

from .candidate import SETTINGS_KEYS, Candidate
from .judgement import Demand, Judgement, Study, judge_law

_ACTIVE = 0.02
"""A demand is active if the law is within this share of its limit."""
_MOVE = 0.1
_UNITS = {"k_p": "rad/m", "k_d": "rad s/m"}
_MEANINGS = {
    "settling": "a mode slower than sigma",
    "delay margin": "unstable within the delay margin",
    "actuator lag": "unstable behind the actuator lag",
    "PD settling": "PD alone slower than sigma",
    "PD damping": "PD alone outside the cone",
    "PD bandwidth": "PD alone beyond the bandwidth R",
}
"""Text for a failed demand that is not a number."""
_NUMBER_UNITS = {
    "RMS error": " m",
    "peak sensitivity": "",
    "noise gain": " rad/m",
    "steer": " rad",
    "steer rate": " rad/s",
}


class Reason(NamedTuple):
    """A parameter, and the law when it alone is moved down or up by a tenth."""

    key: str
    value: float
    down: Judgement
    up: Judgement


def reasons(study: Study, candidate: Candidate) -> Iterator[Reason]:
    """Yield the reason for each parameter."""
    values = candidate.values()
    for key, value in values.items():
        down, up = (
            judge_law(study, candidate.law, {**values, key: value * factor})
            for factor in (1.0 - _MOVE, 1.0 + _MOVE)
        )
        yield Reason(key, value, down, up)


def failed(judgement: Judgement) -> list[str]:
    """Return in words which demands are not met."""
    return [_failure(demand) for demand in judgement.demands if demand.excess]


def outcome(judgement: Judgement, now: float) -> str:
    """Return the effect of a moved parameter on the objective, and the demands it violates."""
    breaks = "; ".join(failed(judgement))
    if judgement.objective == float("inf"):
        return breaks
    change = f"{100.0 * (judgement.objective / now - 1.0):+.1f} %"
    return f"{change}, but {breaks}" if breaks else change


def reason_lines(found: Reason, now: float) -> Iterator[str]:
    """Yield the lines of one parameter; ``now`` is the objective it has."""
    unit = _UNITS.get(found.key, "rad/s")
    yield f"  {SETTINGS_KEYS[found.key]} = {found.value:g} {unit}"
    for label, moved in (("10 % less", found.down), ("10 % more", found.up)):
        yield f"      {label}: {outcome(moved, now)}"


def demand_lines(judgement: Judgement) -> Iterator[str]:
    """Yield one line for each demand that is a number."""
    for demand in judgement.demands:
        if demand.name not in _NUMBER_UNITS:
            continue
        unit = _NUMBER_UNITS[demand.name]
        at_most = "" if demand.limit == float("inf") else f", at most {demand.limit:g}{unit}"
        is_active = demand.limit and demand.value > (1.0 - _ACTIVE) * demand.limit
        note = "  <- active" if is_active else ""
        yield f"  {demand.name:17} {demand.value:.4g}{unit}{at_most}{note}"


def _failure(demand: Demand) -> str:
    if demand.name in _MEANINGS:
        return _MEANINGS[demand.name]
    unit = _NUMBER_UNITS[demand.name]
    return f"{demand.name} {_distinct(demand.value, demand.limit)} above {demand.limit:g}{unit}"


def _distinct(value: float, limit: float) -> str:
    """Return ``value`` with three digits, or with as many as distinguish it from ``limit``."""
    for digits in range(3, 17):
        text = f"{value:.{digits}g}"
        if float(text) != limit:
            break
    return text
