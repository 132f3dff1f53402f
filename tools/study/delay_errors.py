"""The delay that the controllers report against the true one: for runs of the nodes."""

from collections.abc import Sequence

import numpy as np

from ...closed_loop.reports.page import Cell, Section, Table, number
from ...closed_loop.studies.result_reader import Rows, StudyRecord
from ...runtime.array_types import BoolArray


def delay_sections(study: StudyRecord, rows: Rows) -> list[Section]:
    """Return the section of the runs that hold; none where no run reported a delay."""
    chosen = rows.holds & np.isfinite(rows.estimate_share)
    if not chosen.any():
        return []
    headings = (
        *("runs", "with an estimate [%]", "never"),
        *("error, 5 / 50 / 95 % [ms]", "largest [ms]", "echo's error [ms]"),
    )
    by_law = [
        (Cell(name), *_cells(rows, chosen & (rows.controller == place)))
        for place, name in enumerate(study.names)
    ]
    tables = [Table(("Controller", *headings), by_law)]
    for factor in study.factors:
        if len(factor.labels) > 1:
            column = rows.factors[factor.name]
            lines = [
                (Cell(str(label)), *_cells(rows, chosen & (column == label)))
                for label in dict.fromkeys(column.tolist())
            ]
            tables.append(Table((factor.name, *headings), lines))
    return [
        Section(
            "The reported delay",
            (
                "What DELAY_STATUS says, against the true delay, in the runs that hold the path. "
                "An estimate is given for some share of the time, or never. The errors are "
                "quantiles over runs of each run's median, and the largest of all.",
            ),
            tables=tables,
        )
    ]


def _cells(rows: Rows, chosen: BoolArray) -> Sequence[Cell]:
    share = rows.estimate_share[chosen]
    known = chosen & (rows.estimate_share > 0.0)
    if not known.any():
        return [number(str(len(share))), number("0"), number(str(len(share))), *[number("-")] * 3]
    low, middle, high = 1e3 * np.quantile(rows.estimate_error_s[known], (0.05, 0.5, 0.95))
    return [
        number(str(len(share))),
        number(f"{100.0 * share.mean():.0f}"),
        number(str(int(np.count_nonzero(share == 0.0)))),
        number(f"{low:+.1f} / {middle:+.1f} / {high:+.1f}"),
        number(f"{1e3 * rows.estimate_error_max_s[known].max():.1f}"),
        number(f"{1e3 * np.nanmean(rows.echo_error_s[chosen]):+.1f}"),
    ]
