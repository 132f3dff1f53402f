"""The axes of a study's pictures: mean latency and jitter, by level or, where drawn, by bin."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ...closed_loop.studies.result_files import are_numbers
from ...closed_loop.studies.result_reader import FactorRecord, Rows, StudyRecord
from ...runtime.array_types import IntArray

LATENCY = "plant.latency."
BINS = 10
LEVELS_MAX = 40
"""More levels than fit on the axis go into bins."""


class Axis(NamedTuple):
    """One axis; a study that varies no such thing has one level, whose ``factor`` is None.

    ``values``  of the levels, or of the middle of each bin
    ``labels``  as printed at the axis
    ``place``   of each row
    """

    title: str
    factor: FactorRecord | None
    values: tuple[float, ...]
    labels: tuple[str, ...]
    place: IntArray

    @property
    def keys(self) -> tuple[str, ...]:
        """The settings that vary along it."""
        return () if self.factor is None else self.factor.keys


class StudyAxes(NamedTuple):
    """``group`` is the same for rows that differ in latency and jitter only."""

    mean: Axis
    jitter: Axis
    group: IntArray
    others: tuple[str, ...]


def study_axes(study: StudyRecord, rows: Rows) -> StudyAxes:
    """Return the axes of a study, of the downlink if both directions vary independently."""
    mean = _factor(study.factors, ("mean_s",))
    jitter = _factor(study.factors, ("spread_fraction", "spread_s"))
    others = [f.name for f in study.factors if f not in (mean, jitter)]
    group = same_levels(np.zeros(len(rows.id), dtype=np.int64), rows, others)
    return StudyAxes(
        _axis(mean, rows, "mean latency [ms]", 1e3),
        _axis(jitter, rows, *_jitter_title(jitter)),
        group,
        tuple(others),
    )


def same_levels(key: IntArray, rows: Rows, factors: Sequence[str]) -> IntArray:
    """Return a number for each row, the same where ``key`` and the levels of factors are."""
    for name in factors:
        _, place = np.unique(rows.factors[name], return_inverse=True)
        _, key = np.unique(key * (int(place.max()) + 1) + place, return_inverse=True)
    return np.asarray(key, dtype=np.int64)


def _factor(factors: Sequence[FactorRecord], endings: tuple[str, ...]) -> FactorRecord | None:
    def is_of(key: str) -> bool:
        return key.startswith(LATENCY) and key.rpartition(".")[2] in endings

    # Levels may have names, which have no place on an axis.
    scaled = [factor for factor in factors if factor.keys and are_numbers(factor.labels)]
    found = [factor for factor in scaled if all(map(is_of, factor.keys))]
    found.sort(key=lambda factor: not any("downlink" in key for key in factor.keys))
    return found[0] if found else None


def _jitter_title(factor: FactorRecord | None) -> tuple[str, float]:
    if factor is not None and all(key.endswith("spread_s") for key in factor.keys):
        return "jitter: standard deviation [ms]", 1e3
    return "jitter: standard deviation / mean [%]", 100.0


def _axis(factor: FactorRecord | None, rows: Rows, title: str, scale: float) -> Axis:
    if factor is None:
        return Axis(title, None, (np.nan,), ("as set",), np.zeros(len(rows.id), dtype=np.int64))
    column = np.asarray(rows.factors[factor.name], dtype=np.float64)
    levels, place = np.unique(column, return_inverse=True)
    if len(levels) > LEVELS_MAX:
        edges = np.linspace(levels[0], levels[-1], BINS + 1)
        place = np.clip(np.searchsorted(edges, column, side="right") - 1, 0, BINS - 1)
        levels = 0.5 * (edges[:-1] + edges[1:])
    labels = tuple(f"{scale * level:.3g}" for level in levels.tolist())
    return Axis(title, factor, tuple(levels.tolist()), labels, np.asarray(place, dtype=np.int64))


def cells(axes: StudyAxes, rows: Rows, controllers: int) -> tuple[IntArray, tuple[int, int, int]]:
    """Return the cell of each row, and the shape (controllers, jitters, means) of all cells."""
    shape = (controllers, len(axes.jitter.values), len(axes.mean.values))
    place: Any = np.ravel_multi_index((rows.controller, axes.jitter.place, axes.mean.place), shape)
    return place, shape
