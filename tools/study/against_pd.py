"""Each law against PD under the same conditions and the same network (common random numbers).

q = RMS of the law / RMS of the reference        run by run, where both hold the path
"""

import math

import numpy as np

from ...closed_loop.reports.page import Cell, Section, Table, number
from ...closed_loop.studies.result_reader import Rows, held
from ...closed_loop.studies.study import Study
from ...runtime.array_types import FloatArray

_HEADINGS = (
    *("Controller", "runs held", "it holds, reference not", "reference holds, it not"),
    *("RMS ratio, median", "10 to 90 % of ratios", "better in"),
    *("RMS held, median [mm]", "RMS held, largest [mm]"),
    *("steer RMS [mrad]", "steer rate RMS [mrad/s]", "periods at a limit [%]"),
)


def comparison_section(study: Study, rows: Rows) -> Section:
    """Return the comparison of every controller with the reference, itself included."""
    laws = [str(tables["law"]) for tables in study.controllers.values()]
    reference = study.names[laws.index("pd") if "pd" in laws else 0]
    lines = [_line(study, rows, name, reference) for name in study.names]
    return Section(
        f"Against {reference}",
        (
            f"Each run is compared with the run of {reference} under the same conditions and on "
            "the same network (common random numbers). Ratios are of those pairs in which both "
            "hold the path: below 1 the law is better. Errors are those of the car. The "
            "steer's columns are medians over all runs of a law, those that do not hold too.",
        ),
        tables=(Table(_HEADINGS, lines),),
    )


def _line(study: Study, rows: Rows, name: str, reference: str) -> tuple[Cell, ...]:
    case, holds = rows["id"] // len(study.names), held(rows)
    its, others = (np.flatnonzero(rows["controller"] == each) for each in (name, reference))
    _, of_it, of_reference = np.intersect1d(
        case[its], case[others], assume_unique=True, return_indices=True
    )
    one, other = its[of_it], others[of_reference]
    both = holds[one] & holds[other]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = rows["rms_m"][one][both] / rows["rms_m"][other][both]
    ratios = ratios[np.isfinite(ratios)]
    low, high = np.quantile(ratios, [0.1, 0.9]) if len(ratios) else (math.nan, math.nan)
    better = f"{100 * np.mean(ratios < 1.0):.1f} %" if len(ratios) else "-"
    kept = its[holds[its]]
    largest_m = float(rows["rms_m"][kept].max()) if len(kept) else math.nan
    texts = (
        f"{len(kept):,} ({100 * len(kept) / max(len(its), 1):.1f} %)",
        f"{np.count_nonzero(holds[one] & ~holds[other]):,}",
        f"{np.count_nonzero(~holds[one] & holds[other]):,}",
        _ratio(_median(ratios)),
        f"{_ratio(low)} to {_ratio(high)}",
        better,
        _millimetres(_median(rows["rms_m"][kept])),
        _millimetres(largest_m),
        three_digits(1e3 * _median(rows["steer_rms_rad"][its])),
        three_digits(1e3 * _median(rows["steer_rate_rms_rad_s"][its])),
        three_digits(100.0 * _median(rows["limited_share"][its])),
    )
    return Cell(name), *map(number, texts)


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan


def three_digits(value: float) -> str:
    """Return a figure that may be unknown, with three digits."""
    return "-" if math.isnan(value) else f"{float(f'{value:.3g}'):,g}"


def _ratio(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3f}"


def _millimetres(value_m: float) -> str:
    return three_digits(1e3 * value_m)
