"""The list of the day: who drove best, as all pages show it."""

import time
from collections.abc import Mapping, Sequence
from typing import Any

_SHOWN = 8


class BestOfTheDay:
    """Keeps all scores, and shows the best of today."""

    def __init__(self) -> None:
        self._scores: list[Mapping[str, Any]] = []

    def add(self, name: str, title: str, score: Mapping[str, float]) -> None:
        """Add a driver's score in a scenario, with its ``rms_m`` and ``in_lane``."""
        self._scores.append({"day": time.strftime("%F"), "name": name, "title": title, **score})

    def shown(self) -> Sequence[Mapping[str, Any]]:
        """Return the best of today, by the time in the lane and then by the error."""
        today = [score for score in self._scores if score["day"] == time.strftime("%F")]
        today.sort(key=lambda score: (-score["in_lane"], score["rms_m"]))
        keys = ("name", "title", "rms_m", "in_lane")
        return [{key: score[key] for key in keys} for score in today[:_SHOWN]]
