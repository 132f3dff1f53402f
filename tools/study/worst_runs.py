"""The worst runs of a study, and the commands that repeat them.

The worst are runs that left the range of the sensor, the earliest first; then those with the
largest RMS error. Of replicates only the worst is taken: they differ in their seeds alone, or not
at all. A run that never started is left out.
"""

import numpy as np

from ...closed_loop.reports.page import Cell, Section, Table, number
from ...closed_loop.studies.result_reader import VERDICTS, Rows, StudyRecord
from ...plant_emulator.evaluation.run_verdict import Verdict

COUNT = 10
ALIKE = 1.1
"""Largest over smallest error of runs that are alike."""


def worst_rows(study: StudyRecord, rows: Rows) -> list[int]:
    """Return the places of the worst runs, the worst first; COUNT at most."""
    has_left = rows.verdict == VERDICTS.index(Verdict.LEFT_RANGE)
    known = np.flatnonzero(np.isfinite(rows.rms_m))
    left_s = np.where(has_left[known], rows.duration_s[known], np.inf)
    worst_first = known[np.lexsort((-rows.rms_m[known], left_s))]
    point = rows.case[worst_first] // int(study.sampling["replicates"])
    _, first = np.unique(point * len(study.names) + rows.controller[worst_first], return_index=True)
    chosen: list[int] = worst_first[np.sort(first)[:COUNT]].tolist()
    return chosen


def are_alike(rows: Rows) -> bool:
    """Whether all runs hold with nearly the same error, so that none is worse than others."""
    holds = bool(np.all(rows.verdict == VERDICTS.index(Verdict.HOLDS)))
    return holds and float(np.max(rows.rms_m)) <= ALIKE * float(np.min(rows.rms_m))


def worst_sections(study: StudyRecord, rows: Rows) -> list[Section]:
    """Return the worst runs and the commands that repeat them; none if all are alike."""
    if are_alike(rows):
        return []
    lines = [
        (
            number(f"{rank}."),
            Cell(study.names[rows.controller[row]]),
            Cell(conditions(study, rows, row)),
            Cell(str(VERDICTS[rows.verdict[row]])),
            number(f"{1e3 * rows.rms_m[row]:.4g}"),
            number(f"{1e3 * rows.peak_m[row]:.4g}"),
            Cell(study.replay(rows.id[row]), "code"),
        )
        for rank, row in enumerate(worst_rows(study, rows), start=1)
    ]
    headings = ("", "Controller", "Conditions", "Verdict", "RMS [mm]", "Peak [mm]", "Again")
    text = (
        "Runs that left the range of the sensor come first, then the largest RMS error; of "
        "the replicates of one point only the worst."
    )
    return [Section("The worst runs", (text,), tables=(Table(headings, lines),))]


def conditions(study: StudyRecord, rows: Rows, row: int) -> str:
    """Return the values of the factors in a row, in one line."""
    texts = []
    for factor in study.factors:
        value = rows.factors[factor.name][row]
        texts.append(f"{factor.name} {f'{value:.4g}' if isinstance(value, float) else value}")
    return ", ".join(texts)
