"""Each law against PD under the same conditions and the same network (common random numbers).

q = RMS of the law / RMS of the reference        run by run, where both hold the path
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...closed_loop.reports.page import Cell, Section, Table, number
from ...closed_loop.studies.result_reader import Rows, StudyRecord
from ...runtime.array_types import FloatArray


class Comparison(NamedTuple):
    """One controller; the ratios are NaN where there is no pair in which both hold.

    ``only_it``, ``only_reference``  pairs of runs in which only the one or the other holds
    ``low``, ``median``, ``high``    of the ratios: 10th, 50th, 90th percentile
    ``better``                       share of the ratios below 1
    ``steer_*``, ``limited_share``   steering effort: medians of all its runs, held or not
    """

    controller: int
    runs: int
    held: int
    only_it: int
    only_reference: int
    low: float
    median: float
    high: float
    better: float
    rms_median_m: float
    rms_worst_held_m: float
    cg_rms_median_m: float
    steer_rms_rad: float
    steer_rate_rms_rad_s: float
    limited_share: float


def comparisons(study: StudyRecord, rows: Rows) -> list[Comparison]:
    """Return the comparison of every controller with the reference, itself included."""
    return [_comparison(study, rows, place) for place in range(len(study.names))]


def _comparison(study: StudyRecord, rows: Rows, place: int) -> Comparison:
    it = np.flatnonzero(rows.controller == place)
    reference = np.flatnonzero(rows.controller == study.reference)
    _, of_it, of_reference = np.intersect1d(
        rows.case[it], rows.case[reference], assume_unique=True, return_indices=True
    )
    one, other = it[of_it], reference[of_reference]
    both = rows.holds[one] & rows.holds[other]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = rows.rms_m[one][both] / rows.rms_m[other][both]
    ratios = ratios[np.isfinite(ratios)]
    low, middle, high = np.quantile(ratios, [0.1, 0.5, 0.9]) if len(ratios) else [math.nan] * 3
    held_m = rows.rms_m[it][rows.holds[it]]
    return Comparison(
        controller=place,
        runs=len(it),
        held=int(np.count_nonzero(rows.holds[it])),
        only_it=int(np.count_nonzero(rows.holds[one] & ~rows.holds[other])),
        only_reference=int(np.count_nonzero(~rows.holds[one] & rows.holds[other])),
        low=float(low),
        median=float(middle),
        high=float(high),
        better=float(np.mean(ratios < 1.0)) if len(ratios) else math.nan,
        rms_median_m=float(np.median(held_m)) if len(held_m) else math.nan,
        rms_worst_held_m=float(held_m.max()) if len(held_m) else math.nan,
        cg_rms_median_m=median(rows.cg_rms_m[it][rows.holds[it]]),
        steer_rms_rad=median(rows.steer_rms_rad[it]),
        steer_rate_rms_rad_s=median(rows.steer_rate_rms_rad_s[it]),
        limited_share=median(rows.limited_share[it]),
    )


def median(values: FloatArray) -> float:
    """Return the median of the known values; NaN where there are none."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan


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
            number(three_digits(1e3 * one.steer_rms_rad)),
            number(three_digits(1e3 * one.steer_rate_rms_rad_s)),
            number(three_digits(100.0 * one.limited_share)),
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
        "steer RMS [mrad]",
        "steer rate RMS [mrad/s]",
        "periods at a limit [%]",
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


def three_digits(value: float) -> str:
    """Return a figure that may be unknown, with three digits."""
    return "-" if math.isnan(value) else f"{float(f'{value:.3g}'):,g}"


def ratio(value: float) -> str:
    """Return a ratio that may be unknown."""
    return "-" if math.isnan(value) else f"{value:.3f}"


def millimetres(value_m: float) -> str:
    """Return a length that may be unknown, in millimetres."""
    return three_digits(1e3 * value_m)
