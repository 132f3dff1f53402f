"""Each law over the mean delay: its worst errors, and the first delay at which it breaks.

A condition is a combination of levels of all factors but the mean delay; factors of the vehicle
alone are left out of it, since a vehicle is not known: the worst counts, of vehicles and of
replicates. A law breaks where any of these runs does not hold the path, by the study's verdict.
Errors are those of the car.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter

from ...closed_loop.reports.page import Cell, Picture, Section, Table, number
from ...closed_loop.reports.plot_style import law_styles
from ...closed_loop.studies.factors import Factor
from ...closed_loop.studies.result_files import are_numbers
from ...closed_loop.studies.result_reader import Rows, held
from ...closed_loop.studies.study import Study
from ...runtime.array_types import BoolArray, FloatArray, IntArray
from .against_pd import three_digits

CONDITIONS_MAX = 24
"""More tables than these would not be read."""
SHOWN_MAX = 8
"""Delays in a table; those between are in the picture."""
CURVES_MAX = 8
"""Laws in the picture; ``[report]`` of the study chooses them."""
_LATENCY, _VEHICLE = "plant.latency.", "plant.vehicle."
_TOP_M = 3.0
"""Largest error drawn."""
_PANELS_IN_A_ROW = 3
_MARKS = ("", "o", "s", "^")
"""Of the first controller that runs a law, the second, ...: all have the law's colour."""


class LawByDelay(NamedTuple):
    """Worst figures of shape (conditions, controllers, delays); NaN where nothing was run.

    ``settled_m``  RMS from ``settled_s`` of the verdict on
    ``holds``      whether every run holds
    """

    delays_ms: tuple[float, ...]
    conditions: tuple[str, ...]
    controllers: tuple[str, ...]
    settled_m: FloatArray
    peak_m: FloatArray
    holds: BoolArray

    def breaks_at_ms(self, condition: int, controller: int) -> float | None:
        """Return the first delay at which a law does not hold the path, None if at none."""
        broken = np.flatnonzero(~self.holds[condition, controller])
        return self.delays_ms[broken[0]] if len(broken) else None


def law_by_delay(study: Study, rows: Rows) -> LawByDelay | None:
    """Return the worst figures; None where no delay varies or there are too many conditions."""
    mean = _mean_delay(study.factors)
    if mean is None:
        return None
    others = [factor for factor in study.factors if factor != mean]
    factors = [each for each in others if not all(key.startswith(_VEHICLE) for key in each.keys)]
    if not all(factor.labels for factor in factors):
        return None
    names = [factor.name for factor in factors]
    condition = _same_levels(rows, names)
    _, first = np.unique(condition, return_index=True)
    if len(first) > CONDITIONS_MAX:
        return None
    order = np.argsort(first)  # as in the study
    condition = np.argsort(order)[condition]
    texts = [", ".join(_level(name, rows[name][row]) for name in names) for row in first[order]]
    delays_s, place = np.unique(rows[mean.name].astype(np.float64), return_inverse=True)
    shape = (len(texts), len(study.names), len(delays_s))
    controller = list(map(study.names.index, rows["controller"].tolist()))
    cell = np.ravel_multi_index((condition, controller, place), shape)
    holds = np.ones(shape, dtype=np.bool_)
    np.logical_and.at(holds.reshape(-1), cell, held(rows))
    return LawByDelay(
        tuple(1e3 * delay_s for delay_s in delays_s.tolist()),
        tuple(text or "all runs" for text in texts),
        study.names,
        _worst(cell, rows["settled_rms_m"], shape),
        _worst(cell, rows["peak_m"], shape),
        holds,
    )


def _mean_delay(factors: Sequence[Factor]) -> Factor | None:
    """Return the factor of the mean latency, of the downlink if both directions vary apart."""
    found = [
        factor
        for factor in factors
        if factor.labels
        and are_numbers(factor.labels)  # names have no place on an axis
        and all(key.startswith(_LATENCY) and key.endswith(".mean_s") for key in factor.keys)
    ]
    found.sort(key=lambda factor: not any("downlink" in key for key in factor.keys))
    return found[0] if found else None


def _same_levels(rows: Rows, factors: Sequence[str]) -> IntArray:
    """Return a number for each row, the same where the levels of factors are."""
    key = np.zeros(len(rows["id"]), dtype=np.int64)
    for name in factors:
        _, place = np.unique(rows[name], return_inverse=True)
        _, key = np.unique(key * (int(place.max()) + 1) + place, return_inverse=True)
    return np.asarray(key, dtype=np.int64)


def _level(name: str, value: object) -> str:
    """Return a level in words: a number says nothing without the name of its factor."""
    return str(value) if isinstance(value, str) else f"{name} {value}"


def _worst(cell: IntArray, values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return the largest value of each cell; a run that ended early counts as infinitely far."""
    worst = np.full(int(np.prod(shape)), -np.inf)
    np.maximum.at(worst, cell, np.where(np.isnan(values), np.inf, values))
    return np.where(worst == -np.inf, np.nan, worst).reshape(shape)


def law_section(found: LawByDelay, pictures: Sequence[Picture]) -> Section:
    """Return where each law breaks, then its errors, condition by condition."""
    stride = -(-len(found.delays_ms) // SHOWN_MAX)
    shown = range(0, len(found.delays_ms), stride)
    delays = [f"{found.delays_ms[place]:g} ms" for place in shown]
    conditions = range(len(found.conditions))
    breaks_ms = [
        [found.breaks_at_ms(each, law) for each in conditions]
        for law in range(len(found.controllers))
    ]
    breaks = Table(
        ("breaks at [ms]", *found.conditions),
        [
            (Cell(name), *(number("-" if ms is None else f"{ms:g}") for ms in of_law))
            for name, of_law in zip(found.controllers, breaks_ms, strict=True)
        ],
    )
    tables = [breaks]
    for condition, text in enumerate(found.conditions):
        if not found.holds[condition].any():
            continue
        rms = [
            (Cell(name), *(number(_rms(found, (condition, law, place))) for place in shown))
            for law, name in enumerate(found.controllers)
        ]
        tables.append(Table((f"RMS [mm], {text}", *delays), rms))
    return Section(
        "Law by delay",
        (
            "The first mean delay at which any run of a law does not hold the path, and the worst "
            "RMS of its runs over vehicles and replicates, that of the car from settled_s of the "
            "verdict on. - stands where a run does not hold.",
        ),
        pictures,
        tables,
    )


def largest_deviations(found: LawByDelay) -> list[str]:
    """Return lines with the largest deviation of each law, under each condition and delay."""
    delays = " / ".join(f"{delay_ms:g}" for delay_ms in found.delays_ms)
    heads = [f"largest deviation [m] at {delays} ms", *found.controllers]
    rows = [
        [text, *(" ".join(f"{peak:.2f}" for peak in law) for law in peaks)]
        for text, peaks in zip(found.conditions, found.peak_m.tolist(), strict=True)
    ]
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    return [
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in (heads, *rows)
    ]


def _rms(found: LawByDelay, place: tuple[int, int, int]) -> str:
    return three_digits(1e3 * found.settled_m[place]) if found.holds[place] else "-"


def draw_error_over_delay(
    found: LawByDelay, names: Sequence[str], laws: Mapping[str, str]
) -> Figure:
    """Draw some controllers under the first condition, and the delay at which each breaks.

    ``laws``  that they run, by their names
    """
    figure = Figure(figsize=(9.0, 4.8))
    axes = figure.subplots()
    for name, style in zip(names, law_styles(laws[each] for each in names), strict=True):
        law = found.controllers.index(name)
        breaks_ms = found.breaks_at_ms(0, law)
        fate = "holds throughout" if breaks_ms is None else f"breaks at {breaks_ms:g} ms"
        errors_mm = 1e3 * np.minimum(found.settled_m[0, law], _TOP_M)
        axes.plot(found.delays_ms, errors_mm, lw=1.8, label=f"{name}: {fate}", **style)
        if breaks_ms is not None:
            place = found.delays_ms.index(breaks_ms)
            axes.plot(breaks_ms, errors_mm[place], "x", color=style["color"], ms=11, mew=2.5)
    axes.set_yscale("log")
    for formatter in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        formatter(LogFormatter(labelOnlyBase=False))  # plain numbers, in less than a decade too
    axes.set(xlabel="mean delay [ms]", ylabel="RMS of the car once it has settled, worst [mm]")
    axes.set_title(f"Which delay each law tolerates: {found.conditions[0]}")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def draw_largest_deviations(
    found: LawByDelay, names: Sequence[str], laws: Mapping[str, str]
) -> Figure:
    """Draw the largest deviation of some controllers, in a panel for each condition."""
    rows = -(-len(found.conditions) // _PANELS_IN_A_ROW)
    figure = Figure(figsize=(9.0, 1.0 + 2.2 * rows))
    panels = figure.subplots(rows, _PANELS_IN_A_ROW, sharex=True, sharey=True, squeeze=False)
    used = [laws[name] for name in names]
    for place, (name, style) in enumerate(zip(names, law_styles(used), strict=True)):
        mark = _MARKS[used[:place].count(used[place]) % len(_MARKS)]
        peaks_m = np.minimum(found.peak_m[:, found.controllers.index(name)], _TOP_M)
        for axes, peak_m in zip(panels.flat, peaks_m, strict=False):
            axes.plot(found.delays_ms, peak_m, marker=mark, ms=4, label=name, **style)
    for axes, condition in zip(panels.flat, found.conditions, strict=False):
        axes.set_title(condition, fontsize="medium")
    panels[0, 0].set_yscale("log")
    panels[0, 0].yaxis.set_major_formatter("{x:g}")
    panels[-1, 0].set_xlabel("mean delay [ms]")
    figure.supylabel(f"largest deviation of the car, at most {_TOP_M:g} [m]", fontsize="medium")
    labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(*labels, loc="outside lower center", ncols=2)
    return figure
