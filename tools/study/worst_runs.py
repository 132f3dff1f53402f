"""The worst runs of a study, repeated from their rows, and drawn.

The worst are runs that left the range of the sensor, the earliest first; then those with the
largest RMS error. Of replicates only the worst is taken: they differ in their seeds alone, or not
at all. A run that never started has no trace and is left out.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ...closed_loop.compiled.engine import CompiledRun, run_compiled
from ...closed_loop.reports.page import Cell, Picture, Section, Table, number
from ...closed_loop.reports.plot_style import COLOURS
from ...closed_loop.studies.result_reader import (
    VERDICTS,
    Rows,
    StudyRecord,
    case_of,
    read_overrides,
)
from ...plant_emulator.evaluation.run_verdict import Verdict

COUNT = 10


class WorstRun(NamedTuple):
    """One of the worst runs, repeated."""

    row: int
    id: int
    controller: int
    verdict: Verdict
    run: CompiledRun
    steer_rad_max: float


def worst_runs(study: StudyRecord, rows: Rows) -> list[WorstRun]:
    """Return the worst runs, the worst first; COUNT at most."""
    has_left = rows.verdict == VERDICTS.index(Verdict.LEFT_RANGE)
    known = np.flatnonzero(np.isfinite(rows.rms_m))
    left_s = np.where(has_left[known], rows.duration_s[known], np.inf)
    worst_first = known[np.lexsort((-rows.rms_m[known], left_s))]
    point = rows.case[worst_first] // int(study.sampling["replicates"])
    _, first = np.unique(point * len(study.names) + rows.controller[worst_first], return_index=True)
    chosen = worst_first[np.sort(first)[:COUNT]].tolist()
    overrides = read_overrides(study, [int(rows.id[row]) for row in chosen])
    return [_again(study, rows, row, overrides[int(rows.id[row])]) for row in chosen]


def draw_worst(study: StudyRecord, found: list[WorstRun]) -> Figure:
    """Draw deviations and command of each run, two runs a row."""
    lines = -(-len(found) // 2)
    figure = Figure(figsize=(13.0, 2.5 * lines + 0.6))
    grid = figure.subfigures(lines, 2, squeeze=False)
    for rank, (worst, part) in enumerate(zip(found, grid.flat, strict=False), start=1):
        above, below = part.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.0))
        colour = COLOURS[worst.controller % len(COLOURS)]
        run, label = worst.run, "centre of gravity"
        above.plot(run.time_s, run.lateral_error_m, color=colour, lw=0.9, label="preview point")
        above.plot(run.time_s, run.cg_deviation_m, color="0.4", lw=0.7, ls=":", label=label)
        below.plot(run.tick_s, run.sent_rad, color="0.25", lw=0.6)
        for limit_rad in (-worst.steer_rad_max, worst.steer_rad_max):
            below.axhline(limit_rad, color="black", lw=0.7, ls="--")
        below.set_ylim(-1.15 * worst.steer_rad_max, 1.15 * worst.steer_rad_max)
        above.set_ylabel("off the path [m]", fontsize=9)
        if rank == 1:
            above.legend(fontsize=8)
        below.set_ylabel("steer [rad]", fontsize=9)
        below.set_xlabel("time [s]", fontsize=9)
        above.set_title(
            f"{rank}. {study.names[worst.controller]}, run {worst.id}: {worst.verdict}",
            fontsize=9.5,
        )
    return figure


def conditions(study: StudyRecord, rows: Rows, row: int) -> str:
    """Return the values of the factors in a row, in one line."""
    texts = []
    for factor in study.factors:
        value = rows.factors[factor.name][row]
        texts.append(f"{factor.name} {f'{value:.4g}' if isinstance(value, float) else value}")
    return ", ".join(texts)


def _again(study: StudyRecord, rows: Rows, row: int, overrides: dict[str, Any]) -> WorstRun:
    controller = int(rows.controller[row])
    pair = study.scenarios.checked(case_of(overrides), study.names[controller])
    return WorstRun(
        row=row,
        id=int(rows.id[row]),
        controller=controller,
        verdict=VERDICTS[int(rows.verdict[row])],
        run=run_compiled(pair.plant, pair.controller),
        steer_rad_max=pair.controller.steer_limits.steer_rad_max,
    )


def worst_section(
    study: StudyRecord, rows: Rows, found: Sequence[WorstRun], pictures: Sequence[Picture]
) -> Section:
    """Return the worst runs and the commands that repeat them."""
    lines = [
        (
            number(f"{rank}."),
            Cell(study.names[worst.controller]),
            Cell(conditions(study, rows, worst.row)),
            Cell(str(worst.verdict)),
            number(f"{1e3 * rows.rms_m[worst.row]:.4g}"),
            number(f"{1e3 * rows.peak_m[worst.row]:.4g}"),
            Cell(study.replay(worst.id), "code"),
        )
        for rank, worst in enumerate(found, start=1)
    ]
    headings = ("", "Controller", "Conditions", "Verdict", "RMS [mm]", "Peak [mm]", "Again")
    return Section(
        "The worst runs",
        (
            "Runs that left the range of the sensor come first, then the largest RMS error; of "
            "the replicates of one point only the worst. The traces are computed again from what "
            "the rows say. Dashed: the limits of the command.",
        ),
        pictures,
        (Table(headings, lines),),
    )
