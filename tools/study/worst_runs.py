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


def worst_section(study: StudyRecord, rows: Rows) -> Section:
    """Return the worst runs and the commands that repeat them."""
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
    return Section(
        "The worst runs",
        (
            "Runs that left the range of the sensor come first, then the largest RMS error; of "
            "the replicates of one point only the worst.",
        ),
        tables=(Table(headings, lines),),
    )


def conditions(study: StudyRecord, rows: Rows, row: int) -> str:
    """Return the values of the factors in a row, in one line."""
    texts = []
    for factor in study.factors:
        value = rows.factors[factor.name][row]
        texts.append(f"{factor.name} {f'{value:.4g}' if isinstance(value, float) else value}")
    return ", ".join(texts)
