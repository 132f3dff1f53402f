"""Levels of the factors other than the network: the effect of a derivative, a noise or a corner.

    q = RMS at a level / RMS at the first level     run by run, law by law, all else the same

Every run is paired with that of the same law, replicate (so the same network, noise and seed) and
levels of all other factors. Only factors with a few levels are compared. For those that are drawn,
or belong to the network, see the heat maps.
"""

from typing import NamedTuple

import numpy as np

from ...closed_loop.reports.page import Cell, Section, Table, number
from ...closed_loop.studies.result_reader import FactorRecord, Rows, StudyRecord
from ...runtime.array_types import IntArray
from .against_pd import median, ratio
from .axes import LATENCY, same_levels

LEVELS_MAX = 12


class Ratios(NamedTuple):
    """One law at one level against the first level: medians over pairs, 1 at the first itself."""

    controller: int
    level: str
    error: float
    steer: float
    steer_rate: float


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


def _is_at(rows: Rows, factor: FactorRecord, label: object) -> IntArray:
    column = rows.factors[factor.name]
    return np.asarray(column == (str(label) if column.dtype == object else label))


def level_sections(study: StudyRecord, rows: Rows) -> list[Section]:
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
