"""The text and tables of the page, section by section."""

import math
from collections.abc import Sequence

from ...closed_loop.reports.page import Cell, Picture, Section, Table, number
from ...closed_loop.studies.result_reader import Rows, StudyRecord
from .axes import StudyAxes
from .break_points import (
    CANDIDATES_MAX,
    CONFIDENCE,
    GROUPS_MAX,
    HELD_SHARE,
    LATENCY_NS_MAX,
    STEP_NS,
    BreakPoint,
)
from .comparison import Comparison, Effort
from .worst_runs import WorstRun, conditions

EFFORT_HEADINGS = ("steer RMS [mrad]", "steer rate RMS [mrad/s]", "periods at a limit [%]")


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
    study: StudyRecord, axes: StudyAxes, points: Sequence[BreakPoint], pictures: Sequence[Picture]
) -> Section:
    """Return the break-points."""
    if not points:
        return Section("Break-points", ("The study varies no mean latency: there are none.",))
    seeds = max(len(point.by_seed_s) for point in points)
    share, sure = f"{100 * HELD_SHARE:g} %", f"{100 * CONFIDENCE:g} %"
    rows = [
        (
            Cell(study.names[point.controller]),
            number(axes.jitter.labels[point.jitter]),
            number(_latency(point.held_s)),
            number(_latency(point.median_s)),
            number(_from_to(point.low_s, point.high_s)),
            number(_from_to(point.by_seed_s[0], point.by_seed_s[-1])),
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
            number(f"{one.held:,} ({100 * one.held / max(one.runs, 1):.1f} %)"),
            number(f"{one.only_it:,}"),
            number(f"{one.only_reference:,}"),
            number(ratio(one.median)),
            number(f"{ratio(one.low)} to {ratio(one.high)}"),
            number("-" if math.isnan(one.better) else f"{100 * one.better:.1f} %"),
            number(millimetres(one.rms_median_m)),
            number(millimetres(one.rms_worst_held_m)),
            number(millimetres(one.cg_rms_median_m)),
            *effort_cells(one.effort),
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
        "RMS held, median [mm]",
        "RMS held, largest [mm]",
        "centre of gravity, median [mm]",
        *EFFORT_HEADINGS,
    )
    return Section(
        f"Against {reference}",
        (
            f"Each run is compared with the run of {reference} under the same conditions and on "
            "the same network (common random numbers). Ratios are of those pairs in which both "
            "hold the path: below 1 the law is better. Errors are those of the preview point, but "
            "for the column of the centre of gravity, of the runs held too. The steer's columns "
            "are medians over all "
            "runs of a law, those that do not hold too.",
        ),
        tables=(Table(headings, rows),),
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
            "the replicates of one point only the worst. The traces are computed anew from what "
            "the rows say. Dashed: the limits of the command.",
        ),
        pictures,
        (Table(headings, lines),),
    )


def _from_to(low_s: float, high_s: float) -> str:
    return f"{_latency(low_s)} to {_latency(high_s)}"


def _latency(seconds: float) -> str:
    if math.isnan(seconds):
        return "-"
    if seconds < 0.0:
        return "none"
    return f"≥ {1e3 * seconds:.0f}" if seconds * 1e9 >= LATENCY_NS_MAX else f"{1e3 * seconds:.0f}"


def effort_cells(effort: Effort) -> tuple[Cell, Cell, Cell]:
    """Return the steering effort of a law, under EFFORT_HEADINGS."""
    return (
        number(three_digits(1e3 * effort.steer_rms_rad)),
        number(three_digits(1e3 * effort.steer_rate_rms_rad_s)),
        number(three_digits(100.0 * effort.limited_share)),
    )


def three_digits(value: float) -> str:
    """Return a figure that may be unknown, with three digits."""
    return "-" if math.isnan(value) else f"{float(f'{value:.3g}'):,g}"


def ratio(value: float) -> str:
    """Return a ratio that may be unknown."""
    return "-" if math.isnan(value) else f"{value:.3f}"


def millimetres(value_m: float) -> str:
    """Return a length that may be unknown, in millimetres."""
    return three_digits(1e3 * value_m)
