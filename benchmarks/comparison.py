"""A benchmark beside a saved one: what has become slower."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from steer_by_wire.runtime.settings import SettingsError

SLOWER = 1.3
"""From this factor on a figure counts as slower: repetitions on a busy machine differ by less."""


class Change(NamedTuple):
    """One figure before and now; ``factor`` is now over before, in calibration loops each."""

    name: str
    factor: float


def read_ratios(file: Path) -> dict[str, float]:
    """Return the ratios to the calibration loop in a saved benchmark; raises SettingsError."""
    try:
        return ratios_of(json.loads(file.read_text(encoding="utf-8"))["lines"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SettingsError(f"{file}: not a saved benchmark") from error


def ratios_of(records: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the ratio of each line of a benchmark, by name."""
    ratios = {str(record["name"]): float(record["ratio_to_calibration"]) for record in records}
    if not all(ratio > 0.0 for ratio in ratios.values()):
        raise ValueError("a ratio is not positive")
    return ratios


def changes(before: Mapping[str, float], now: Mapping[str, float]) -> list[Change]:
    """Return how each figure that both have has changed, the worst first."""
    both = [Change(name, now[name] / before[name]) for name in now if name in before]
    return sorted(both, key=lambda change: -change.factor)


def comparison_text(before: Mapping[str, float], now: Mapping[str, float]) -> str:
    """Return what got slower, one line each, and what only one of the two has."""
    lines = [
        f"slower: {change.name}, {change.factor:.2f} times what it was"
        for change in changes(before, now)
        if change.factor > SLOWER
    ]
    if not lines:
        lines = [f"nothing is slower by more than {SLOWER:g} times"]
    lines += [f"new: {name}" for name in now if name not in before]
    lines += [f"gone: {name}" for name in before if name not in now]
    return "\n".join(lines)
