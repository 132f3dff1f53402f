"""The section that compares levels of factors: the effect of a derivative or a noise on a law."""

from collections.abc import Sequence

from ...reports.page import Cell, Section, Table, number
from .axes import StudyAxes
from .level_comparison import Condition, compared_factors, conditions_by_level, level_ratios
from .results import FactorRecord, Rows, StudyRecord
from .sections import EFFORT_HEADINGS, effort_cells, millimetres, ratio, three_digits

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
        tables.append(_conditions(study, factors, conditions))
        if 1 < latencies <= LATENCIES_MAX:
            tables.append(_by_latency(study, factors, conditions, axes.mean.labels))
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
    study: StudyRecord, factors: Sequence[FactorRecord], conditions: Sequence[Condition]
) -> Table:
    headings = (
        *("Controller", *(factor.name for factor in factors), "runs held", "RMS error [mm]"),
        *EFFORT_HEADINGS,
    )
    cells = [
        (
            Cell(study.names[one.controller]),
            *map(Cell, one.levels),
            number(f"{one.held:,} of {one.runs:,}"),
            number(millimetres(one.rms_m)),
            *effort_cells(one.effort),
        )
        for one in conditions
    ]
    return Table(headings, cells)


def _by_latency(
    study: StudyRecord,
    factors: Sequence[FactorRecord],
    conditions: Sequence[Condition],
    latencies_ms: Sequence[str],
) -> Table:
    headings = (
        *("Controller", *(factor.name for factor in factors)),
        *(f"steer [mrad], {label} ms" for label in latencies_ms),
        *(f"error [mm], {label} ms" for label in latencies_ms),
    )
    cells = [
        (
            Cell(study.names[one.controller]),
            *map(Cell, one.levels),
            *(number(three_digits(1e3 * value)) for value in one.steer_by_latency_rad),
            *(number(millimetres(value)) for value in one.rms_by_latency_m),
        )
        for one in conditions
    ]
    return Table(headings, cells)
