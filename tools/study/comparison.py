"""Each law against PD under the same conditions and the same network (common random numbers).

q = RMS of the law / RMS of the reference        run by run, where both hold the path
"""

import math
from typing import NamedTuple

import numpy as np

from ...closed_loop.studies.result_reader import Rows, StudyRecord
from ...runtime.array_types import FloatArray, IntArray


class Effort(NamedTuple):
    """Steering effort of runs: medians over them."""

    steer_rms_rad: float
    steer_rate_rms_rad_s: float
    limited_share: float


class Comparison(NamedTuple):
    """One controller; the ratios are NaN where there is no pair in which both hold.

    ``only_it``, ``only_reference``  pairs of runs in which only the one or the other holds
    ``low``, ``median``, ``high``    of the ratios: 10th, 50th, 90th percentile
    ``better``                       share of the ratios below 1
    ``effort``                       of all its runs, including those that do not hold
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
    effort: Effort


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
        effort=effort(rows, it),
    )


def effort(rows: Rows, chosen: IntArray) -> Effort:
    """Return the effort of some rows, given as indices."""
    columns = (rows.steer_rms_rad, rows.steer_rate_rms_rad_s, rows.limited_share)
    return Effort(*(median(column[chosen]) for column in columns))


def median(values: FloatArray) -> float:
    """Return the median of the known values; NaN where there are none."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan
