"""Levels of the factors other than the network: the effect of a derivative, a noise or a corner.

    q = RMS at a level / RMS at the first level     run by run, law by law, all else the same

Every run is paired with that of the same law, replicate (so the same network, noise and seed) and
levels of all other factors. Only factors with a few levels are compared. For those that are drawn,
or belong to the network, see the heat maps and break-points.
"""

from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from ...closed_loop.reports.page import Cell, Section, Table, number
from ...closed_loop.studies.result_reader import FactorRecord, Rows, StudyRecord
from ...runtime.array_types import IntArray
from .against_pd import (
    EFFORT_HEADINGS,
    Effort,
    effort,
    effort_cells,
    median,
    millimetres,
    ratio,
    three_digits,
)
from .axes import LATENCY, StudyAxes, same_levels

LEVELS_MAX = 12
CELLS_MAX = 120
"""Rows of the table of all combinations; a longer table would not be read."""


class Ratios(NamedTuple):
    """One law at one level against the first level: medians over pairs, 1 at the first itself."""

    controller: int
    level: str
    error: float
    steer: float
    steer_rate: float


class Condition(NamedTuple):
    """One law under one combination of levels; the figures are medians over its runs.

    ``..._by_latency``  RMS of error and steer at each mean latency; empty if not requested
    """

    controller: int
    levels: tuple[str, ...]
    runs: int
    held: int
    rms_m: float
    effort: Effort
    rms_by_latency_m: tuple[float, ...]
    steer_by_latency_rad: tuple[float, ...]


def compared_factors(study: StudyRecord) -> list[FactorRecord]:
    """Return the factors that are compared level by level."""
    return [
        factor
        for factor in study.factors
        if 2 <= len(factor.labels) <= LEVELS_MAX
        and not any(key.startswith(LATENCY) for key in factor.keys)
    ]


def level_ratios(study: StudyRecord, rows: Rows, factor: FactorRecord) -> list[Ratios]:
    """Return the effect of the levels of a factor, law by law."""
    others = [other.name for other in study.factors if other.name != factor.name]
    rest = same_levels(rows.case % int(study.sampling["replicates"]), rows, others)
    found = []
    for controller in range(len(study.names)):
        own = rows.controller == controller
        first = np.flatnonzero(own & _is_at(rows, factor, factor.labels[0]))
        for label in factor.labels:
            at = np.flatnonzero(own & _is_at(rows, factor, label))
            _, here, there = np.intersect1d(rest[at], rest[first], return_indices=True)
            one, other = at[here], first[there]
            with np.errstate(divide="ignore", invalid="ignore"):
                ratios = [
                    median(column[one] / column[other])
                    for column in (rows.rms_m, rows.steer_rms_rad, rows.steer_rate_rms_rad_s)
                ]
            found.append(Ratios(controller, str(label), *ratios))
    return found


def conditions_by_level(
    study: StudyRecord, rows: Rows, factors: list[FactorRecord], latency: IntArray | None = None
) -> list[Condition]:
    """Return every law under every combination of levels, with those of the first factor beside
    each other; none where they are too many.

    ``latency``  the place of each row's mean latency, to have the figures by it too
    """
    places = [] if latency is None else np.unique(latency).tolist()
    turned = product(*(factor.labels for factor in reversed(factors)))
    combinations = [tuple(reversed(labels)) for labels in turned]
    if not factors or len(combinations) * len(study.names) > CELLS_MAX:
        return []
    found = []
    for controller in range(len(study.names)):
        for labels in combinations:
            chosen = rows.controller == controller
            for factor, label in zip(factors, labels, strict=True):
                chosen &= _is_at(rows, factor, label)
            at = np.flatnonzero(chosen)
            by_latency = [at[latency[at] == place] for place in places if latency is not None]
            if len(at):
                found.append(
                    Condition(
                        controller,
                        tuple(map(str, labels)),
                        len(at),
                        int(np.count_nonzero(rows.holds[at])),
                        median(rows.rms_m[at]),
                        effort(rows, at),
                        tuple(median(rows.rms_m[few]) for few in by_latency),
                        tuple(median(rows.steer_rms_rad[few]) for few in by_latency),
                    )
                )
    return found


def _is_at(rows: Rows, factor: FactorRecord, label: object) -> IntArray:
    column = rows.factors[factor.name]
    return np.asarray(column == (str(label) if column.dtype == object else label))


LATENCIES_MAX = 6
"""More mean latencies than these get no columns; the heat maps have them."""


def level_sections(study: StudyRecord, rows: Rows, axes: StudyAxes) -> list[Section]:
    """Return the section, empty where only the network has levels."""
    factors = compared_factors(study)
    if not factors:
        return []
    names = ", ".join(factor.name for factor in factors)
    tables = [_ratios(study, rows, factor) for factor in factors]
    paragraphs = [
        f"What the levels of {names} make of each law. Ratios are medians over pairs of runs of "
        "the same law, on the same network, noise and all else, which differ in that factor "
        "alone: below 1 the level has less than the first one. Runs that do not hold are among "
        "them."
    ]
    latencies = len(axes.mean.values) if axes.mean.factor is not None else 1
    conditions = conditions_by_level(
        study, rows, factors, axes.mean.place if latencies <= LATENCIES_MAX else None
    )
    if conditions:
        paragraphs.append("Further tables have medians over all runs of a combination of levels.")
        headings = ("runs held", "RMS error [mm]", *EFFORT_HEADINGS)
        tables.append(_conditions(study, factors, conditions, headings, _all_runs))
        if 1 < latencies <= LATENCIES_MAX:
            each = product(("steer [mrad]", "error [mm]"), axes.mean.labels)
            figures = [f"{what}, {latency} ms" for what, latency in each]
            tables.append(_conditions(study, factors, conditions, figures, _by_latency))
    return [Section("Level by level", paragraphs, tables=tables)]


def _ratios(study: StudyRecord, rows: Rows, factor: FactorRecord) -> Table:
    first = str(factor.labels[0])
    cells = [
        (
            Cell(study.names[one.controller]),
            Cell(f"{one.level} / {first}"),
            number(ratio(one.error)),
            number(ratio(one.steer)),
            number(ratio(one.steer_rate)),
        )
        for one in level_ratios(study, rows, factor)
        if one.level != first
    ]
    headings = ("Controller", factor.name, "RMS error", "steer RMS", "steer rate RMS")
    return Table(headings, cells)


def _conditions(
    study: StudyRecord,
    factors: Sequence[FactorRecord],
    conditions: Sequence[Condition],
    headings: Sequence[str],
    cells_of: Callable[[Condition], Sequence[Cell]],
) -> Table:
    """Return a row for each law and combination of levels, with some of its figures."""
    rows = [
        (Cell(study.names[one.controller]), *map(Cell, one.levels), *cells_of(one))
        for one in conditions
    ]
    return Table(("Controller", *(factor.name for factor in factors), *headings), rows)


def _all_runs(one: Condition) -> Sequence[Cell]:
    held = number(f"{one.held:,} of {one.runs:,}")
    return held, number(millimetres(one.rms_m)), *effort_cells(one.effort)


def _by_latency(one: Condition) -> Sequence[Cell]:
    return (
        *(number(three_digits(1e3 * value)) for value in one.steer_by_latency_rad),
        *(number(millimetres(value)) for value in one.rms_by_latency_m),
    )
