"""Random networks: quantiles over the seeds, and the probability that a run leaves the road.

A quantile is the smallest figure that at least that share of the runs keeps to. k of n runs beyond
the road, the study's ``verdict.road_m``, bound the probability of that by Clopper and Pearson:

    P(Bin(n, low) >= k) = P(Bin(n, high) <= k) = (1 - CONFIDENCE)/2

A run that ended early counts as beyond it.
"""

from collections.abc import Sequence

import numpy as np

from ...closed_loop.reports.page import Cell, Section, Table, number
from ...closed_loop.studies.result_reader import Rows, StudyRecord
from ...plant_emulator.evaluation.run_verdict import VerdictRules
from ...runtime.array_types import FloatArray
from .axes import same_levels

SEEDS_MIN = 100
"""Fewer say nothing about the 99th of a hundred runs."""
GROUPS_MAX = 400
"""More lines than these would not be read."""
QUANTILES = (0.5, 0.95, 0.99, 1.0)
CONFIDENCE = 0.95
LOST_M = VerdictRules().road_m
"""A vehicle this far off has left its lane, and how far no longer means anything."""


def seeds_section(study: StudyRecord, rows: Rows) -> Section | None:
    """Return the table; None where seeds are too few."""
    replicates = int(study.sampling["replicates"])
    names = [factor.name for factor in study.factors]
    group = same_levels(rows.controller, rows, names)
    _, first = np.unique(group, return_index=True)
    if replicates < SEEDS_MIN or len(first) > GROUPS_MAX:
        return None
    road_m = float(study.verdict["road_m"])
    lines = []
    for place in np.argsort(first):  # as in the study
        at = np.flatnonzero(group == place)
        lines.append(
            (
                *(Cell(_label(rows.factors[name][at[0]])) for name in names),
                Cell(study.names[rows.controller[at[0]]]),
                *(number(_metres(value_m)) for value_m in _quantiles(rows.peak_m[at])),
                *(number(_metres(value_m)) for value_m in _quantiles(rows.rms_m[at])[-2:]),
                number(beyond(rows.peak_m[at], road_m)),
            )
        )
    headings = (
        *(*names, "Law"),
        *("peak, median [m]", "95 %", "99 %", "worst"),
        *("RMS, 99 % [m]", "worst"),
        f"P(peak beyond {road_m:g} m) [%]",
    )
    return Section(
        "Over seeds",
        (
            f"Lateral error of the preview point in {replicates:,} runs with different seeds: "
            "quantiles of its largest value (peak) and of its RMS over the run. In brackets stands "
            f"the {100 * CONFIDENCE:g} % interval of Clopper and Pearson. 'lost' is a peak beyond "
            f"{LOST_M:g} m, half a lane.",
        ),
        tables=(Table(headings, lines),),
    )


def _quantiles(values: FloatArray) -> Sequence[float]:
    known = np.where(np.isnan(values), np.inf, values)
    found: list[float] = np.quantile(known, QUANTILES, method="inverted_cdf").tolist()
    return found


def beyond(peak_m: FloatArray, road_m: float) -> str:
    """Return the share of peaks beyond the road, and the interval of its probability [%]."""
    from scipy.stats import binomtest

    runs = len(peak_m)
    count = runs - int(np.count_nonzero(peak_m <= road_m))
    interval = binomtest(count, runs).proportion_ci(CONFIDENCE, method="exact")
    low, high = 100.0 * interval.low, 100.0 * interval.high
    return f"{100.0 * count / runs:.1f} ({low:.1f} to {high:.1f})"


def _metres(value_m: float) -> str:
    return "lost" if value_m > LOST_M else f"{value_m:.2f}"


def _label(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
