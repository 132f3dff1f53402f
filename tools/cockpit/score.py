"""The score of a drive, and the list of the day: who drove best, as all pages show it."""

import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

IN_LANE_M = 0.86
"""Deviation of the centre of gravity at which a car of 1.78 m is on the edge of a lane of 3.5 m."""
_SHOWN = 8


class Score:
    """Figures of all lateral errors so far; ``peak_m`` is the largest, 0 before the first."""

    def __init__(self) -> None:
        self._samples = self._in_lane = 0
        self._squares_m2 = self.peak_m = 0.0

    def add(self, error_m: float, cg_deviation_m: float) -> None:
        """Take an error of the preview point; a deviation of NaN is in the lane."""
        self._samples += 1
        self._in_lane += not abs(cg_deviation_m) > IN_LANE_M
        self._squares_m2 += error_m * error_m
        self.peak_m = max(self.peak_m, abs(error_m))

    def figures(self) -> Mapping[str, float]:
        """Return RMS [m] and share of the time in the lane; empty before the first."""
        if not self._samples:
            return {}
        rms_m = math.sqrt(self._squares_m2 / self._samples)
        return {"rms_m": rms_m, "in_lane": self._in_lane / self._samples}


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
