"""The words and tables of the page, section by section."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tools.stress_report.axes import StudyAxes
from tools.stress_report.break_points import (
    CANDIDATES_MAX,
    CONFIDENCE,
    GROUPS_MAX,
    HELD_SHARE,
    LATENCY_NS_MAX,
    STEP_NS,
    BreakPoint,
)
from tools.stress_report.comparison import Comparison
from tools.stress_report.cost_check import DURATION_S_MAX, RUNS, CostCheck
from tools.stress_report.page import Cell, Picture, Section, Table, number
from tools.stress_report.results import VERDICTS, FactorRecord, Rows, StudyRecord
from tools.stress_report.worst_runs import WorstRun, conditions

_LABELS_SHOWN = 16


def study_section(study: StudyRecord, rows: Rows) -> Section:
    """Return what was run, and what became of it."""
    sampling, runs = study.sampling, len(rows.id)
    size = f"{runs:,} runs" if runs == study.runs else f"{runs:,} of {study.runs:,} runs so far"
    texts = {
        "Size": f"{size}: {len(study.names)} controllers, {sampling['replicates']:,} replicates",
        "Points": f"{study.runs // len(study.names) // sampling['replicates']:,}, "
        f"{sampling['kind']}",
        "Seed": f"{sampling['seed']}; all controllers meet the same networks",
        "Arithmetic": "reordered and fused (--fastmath); worst runs and break-points are exact"
        if study.fastmath
        else "that of the nodes, to the last bit",
        "Controllers": ", ".join(study.names),
        **{f"Factor {factor.name}": _factor(factor) for factor in study.factors},
        "Verdict": _flat(study.verdict),
        "Base of the plant": _flat(study.plant),
    }
    settings = Table(
        ("Setting", "Value"), [(Cell(name), Cell(text)) for name, text in texts.items()]
    )
    counts = np.zeros((len(study.names), len(VERDICTS)), dtype=np.int64)
    np.add.at(counts, (rows.controller, rows.verdict), 1)
    verdicts = Table(
        ("Controller", *map(str, VERDICTS)),
        [
            (Cell(name), *(number(f"{count:,}") for count in line))
            for name, line in zip(study.names, counts.tolist(), strict=True)
        ],
    )
    title = study.title or "Latency and jitter, law by law"
    return Section(title, (), tables=(settings, verdicts))


def map_section(axes: StudyAxes, pictures: Sequence[Picture]) -> Section:
    """Return the heat maps."""
    others = f" ({', '.join(axes.others)})" if axes.others else ""
    return Section(
        "Mean latency and jitter",
        (
            f"Each cell shows the worst over everything else that varies{others}: the largest of "
            "the medians over replicates of the RMS lateral error, and the smallest share of "
            "replicates that hold the path. All laws have one scale of colours. A cell is hatched "
            "if any run in it does not hold, however few.",
        ),
        pictures,
    )


def break_point_section(
    study: StudyRecord,
    axes: StudyAxes,
    points: Sequence[BreakPoint],
    pictures: Sequence[Picture],
) -> Section:
    """Return the break-points."""
    if not points:
        return Section("Break-points", ("The study varies no mean latency: there are none.",))
    seeds = len(points[0].by_seed_s)
    share, sure = f"{100 * HELD_SHARE:g} %", f"{100 * CONFIDENCE:g} %"
    rows = [
        (
            Cell(study.names[point.controller]),
            number(axes.jitter.labels[point.jitter]),
            number(_latency(point.held_s)),
            number(_latency(point.median_s)),
            number(f"{_latency(point.low_s)} to {_latency(point.high_s)}"),
            number(f"{_latency(point.by_seed_s[0])} to {_latency(point.by_seed_s[-1])}"),
        )
        for point in sorted(points, key=lambda point: (point.controller, point.jitter))
    ]
    headings = (
        "Controller",
        axes.jitter.title,
        f"held by {share} of seeds, {sure} sure [ms]",
        "median [ms]",
        f"{sure} interval [ms]",
        f"all {seeds} seeds [ms]",
    )
    return Section(
        "Break-points",
        (
            "The largest mean latency that each law holds, searched by bisection with each of "
            f"{seeds} seeds to {1e-6 * STEP_NS:g} ms, up to {1e-6 * LATENCY_NS_MAX:g} ms, under "
            f"the {GROUPS_MAX} of all other conditions of the study in which that law breaks first "
            f"at that jitter (found with the first seed, of the {CANDIDATES_MAX} worst): a latency "
            "is held only if it is under both. These runs come on top of those of the study.",
        ),
        pictures,
        (Table(headings, rows),),
        (
            "Bounds are order statistics of the break-points of the seeds, exact for any "
            "distribution (binomial; for the lowest break-point it is the bound of Clopper and "
            f"Pearson: all {seeds} of {seeds} seeds hold, so that at least "
            f"{100 * (1.0 - CONFIDENCE) ** (1.0 / seeds):.0f} % of all seeds do, {sure} sure). The "
            "search takes for granted that a law that holds a latency holds shorter ones; see the "
            "maps. A slow instability that the length of a run does not show counts as held.",
        ),
    )


def comparison_section(study: StudyRecord, found: Sequence[Comparison]) -> Section:
    """Return the comparison with the reference."""
    reference = study.names[study.reference]
    rows = [
        (
            Cell(study.names[one.controller]),
            number(f"{one.held:,} of {one.runs:,} ({100 * one.held / max(one.runs, 1):.1f} %)"),
            number(f"{one.only_it:,}"),
            number(f"{one.only_reference:,}"),
            number(_ratio(one.median)),
            number(f"{_ratio(one.low)} to {_ratio(one.high)}"),
            number("-" if math.isnan(one.better) else f"{100 * one.better:.1f} %"),
            number(_millimetres(one.rms_median_m)),
            number(_millimetres(one.rms_worst_held_m)),
        )
        for one in found
    ]
    headings = (
        "Controller",
        "runs held",
        "it holds, reference not",
        "reference holds, it not",
        "RMS ratio, median",
        "10 to 90 % of ratios",
        "better in",
        "median RMS [mm]",
        "largest RMS held [mm]",
    )
    return Section(
        f"Against {reference}",
        (
            f"Each run is compared with the run of {reference} under the same conditions and on "
            "the same network (common random numbers). Ratios are of those pairs in which both "
            "hold the path: below 1 the law is better.",
        ),
        tables=(Table(headings, rows),),
    )


def worst_section(
    study: StudyRecord, rows: Rows, found: Sequence[WorstRun], pictures: Sequence[Picture]
) -> Section:
    """Return the worst runs and the commands that make them again."""
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
            "the replicates of one point only the worst. The traces are computed anew from what "
            "the rows say. Dashed: the limits of the command.",
        ),
        pictures,
        (Table(headings, lines),),
    )


def cost_section(
    study: StudyRecord, checks: Sequence[CostCheck], pictures: Sequence[Picture]
) -> Section:
    """Return the expected cost beside the runs."""
    title = "Expected cost, two ways"
    if not checks:
        return Section(title, ("No cell with jitter is held by all laws: nothing to compare.",))
    rows = []
    for check in checks:
        on, off, expected = check.on_grid, check.off_grid, check.expected
        change = 100.0 * (off.mean_square_m2 / on.mean_square_m2 - 1.0)
        cells = ["-", "-", "-"]
        if expected is not None:
            cells = [
                f"{1e6 * expected.mean_square_m2:.6g}",
                f"{check.standard_errors:+.1f}",
                f"{1e6 * math.sqrt(expected.variance_m4):.3g}",
            ]
        rows.append(
            (
                Cell(study.names[check.controller]),
                Cell(check.conditions),
                number(cells[0]),
                number(f"{1e6 * on.mean_square_m2:.6g} ± {1e6 * on.standard_error_m2:.2g}"),
                number(cells[1]),
                number(cells[2]),
                number(f"{1e6 * math.sqrt(on.variance_m4):.3g}"),
                number(f"{change:+.2f} %"),
                number(f"{on.limited} of {RUNS}"),
            )
        )
    headings = (
        "Controller",
        "Latency",
        "E[J], propagated [mm²]",
        "mean J of the runs [mm²]",
        "difference [std. errors]",
        "deviation of J, propagated [mm²]",
        "of the runs [mm²]",
        "J off the grid",
        "runs at a limit",
    )
    reasons = sorted({f"No expected cost: {check.refused}" for check in checks if check.refused})
    duration_s = float(study.plant["duration_s"])
    if duration_s > DURATION_S_MAX:
        reasons.append(f"Only the first {DURATION_S_MAX:g} s of {duration_s:g} s are compared.")
    return Section(
        title,
        (
            "J is the mean square of the lateral error in one run. Its expectation over all seeds "
            "follows from propagating means and covariances of the linear sampled loop through "
            "the Markov chain of the age of the newest command that has arrived (as Jitterbug "
            f"does), and is compared with {RUNS} runs of the batch engine, which share nothing "
            "with it but the numbers of law and vehicle. Latencies are rounded up to control "
            "periods in both, for which the propagation is exact; the last but one column says "
            "what the runs give without rounding. Runs at a limit are not linear.",
            "The picture shows the deviation of the lateral error over seeds: what jitter alone "
            "does to it.",
        ),
        pictures,
        (Table(headings, rows),),
        tuple(reasons),
    )


def _factor(factor: FactorRecord) -> str:
    keys = ", ".join(factor.keys)
    labels = [f"{label:g}" if isinstance(label, float) else str(label) for label in factor.labels]
    if not labels:
        return f"{keys}: drawn"
    shown = labels if len(labels) <= _LABELS_SHOWN else [*labels[:8], "...", *labels[-3:]]
    return f"{keys}: {', '.join(shown)}"


def _flat(tables: Mapping[str, Any], path: str = "") -> str:
    """Return tables in one line, without what is empty."""
    texts = []
    for key, value in tables.items():
        if isinstance(value, dict):
            inner = _flat(value, f"{path}{key}.")
            texts += [inner] if inner else []
        elif value not in ([], None):
            texts.append(f"{path}{key} = {json.dumps(value) if isinstance(value, list) else value}")
    return "; ".join(texts)


def _latency(seconds: float) -> str:
    if math.isnan(seconds):
        return "-"
    if seconds < 0.0:
        return "none"
    return f"≥ {1e3 * seconds:.0f}" if seconds * 1e9 >= LATENCY_NS_MAX else f"{1e3 * seconds:.0f}"


def _ratio(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3f}"


def _millimetres(value_m: float) -> str:
    return "-" if math.isnan(value_m) else f"{1e3 * value_m:.3g}"
