"""The section that compares levels of factors: what a derivative or a noise makes of a law."""

from tools.stress_report.level_comparison import (
    compared_factors,
    conditions_by_level,
    level_ratios,
)
from tools.stress_report.page import Cell, Section, Table, number
from tools.stress_report.results import FactorRecord, Rows, StudyRecord
from tools.stress_report.sections import EFFORT_HEADINGS, effort_cells, millimetres, ratio


def level_sections(study: StudyRecord, rows: Rows) -> list[Section]:
    """Return the section, none where no factor but the network has levels."""
    factors = compared_factors(study)
    if not factors:
        return []
    names = ", ".join(factor.name for factor in factors)
    tables = [_ratios(study, rows, factor) for factor in factors]
    paragraphs = [
        f"What the levels of {names} make of each law. Ratios are medians over pairs of runs of the same law, on "
        "the same network, noise and all else, which differ in that factor alone: below 1 the "
        "level has less than the first one. Runs that do not hold are among them."
    ]
    conditions = conditions_by_level(study, rows, factors)
    if conditions:
        paragraphs.append("The last table has medians over all runs of a combination, whatever their network.")
        headings = (
            *("Controller", *(factor.name for factor in factors), "runs held", "RMS [mm]"),
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
        tables.append(Table(headings, cells))
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
