"""The reactions of both nodes to faults, in the report of a study whose runs have some."""

import numpy as np

from ...closed_loop.reports.page import Cell, Section, Table, number
from ...closed_loop.studies.result_reader import Rows
from ...closed_loop.studies.study import Study
from ...runtime.array_types import BoolArray, FloatArray

_HEADINGS = (
    *("runs with a fault", "reported", "median, slowest [ms]"),
    *("control left", "median, slowest [ms]", "largest error [m]"),
)


def reaction_sections(study: Study, rows: Rows) -> list[Section]:
    """Return the section of the runs in which a fault changed a frame; none without such runs."""
    faulty = np.isfinite(rows.fault_s)
    if not faulty.any():
        return []
    by_law = [(name, faulty & (rows.controller == place)) for place, name in enumerate(study.names)]
    tables = [_table("Controller", by_law, rows)]
    for factor in study.factors:
        if len(factor.labels) > 1:
            column = rows.factors[factor.name]
            labels = dict.fromkeys(column[faulty].tolist())
            chosen = [(str(label), faulty & (column == label)) for label in labels]
            tables.append(_table(factor.name, chosen, rows))
    text = (
        "Times from the first frame that a fault changed: until CONTROLLER_SAFETY or PLANT_STATUS "
        "reported it, and until a command or the steering said that its node had left control."
    )
    return [Section("Reactions to faults", (text,), tables=tables)]


def _table(what: str, chosen: list[tuple[str, BoolArray]], rows: Rows) -> Table:
    lines = [
        (
            Cell(name),
            number(str(int(np.count_nonzero(of)))),
            *_times(rows.reported_s[of]),
            *_times(rows.reaction_s[of]),
            number(f"{np.nanmax(rows.peak_m[of]):.3f}"),
        )
        for name, of in chosen
        if of.any()
    ]
    return Table((what, *_HEADINGS), lines)


def _times(times_s: FloatArray) -> tuple[Cell, Cell]:
    """Return how many of the times there are, and their median and largest."""
    known_ms = 1e3 * times_s[np.isfinite(times_s)]
    if not len(known_ms):
        return number("0"), number("-")
    return number(str(len(known_ms))), number(f"{np.median(known_ms):.0f}, {known_ms.max():.0f}")
