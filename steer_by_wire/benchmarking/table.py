"""Shows the lines of a benchmark: a table for people, records for JSON."""

from collections.abc import Sequence
from typing import Any

from rich import box
from rich.table import Table

from .measurement import Line


def lines_table(lines: Sequence[Line], calibration_us: float | None = None) -> Table:
    """Return a table; with a column of ratios if the calibration loop was timed."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("what")
    ratio = [] if calibration_us is None else ["ratio"]
    for heading in ("median", "least", "most", "unit", *ratio, "target", "verdict"):
        table.add_column(heading, justify="right", no_wrap=True, min_width=len(heading))
    for line in lines:
        figures = (line.median, min(line.figures), max(line.figures))
        verdict = {None: "", True: "met", False: "missed"}[line.is_met]
        table.add_row(
            line.name,
            *(_short(figure) for figure in figures),
            line.unit,
            *([] if calibration_us is None else [_short(line.ratio(calibration_us))]),
            line.target.text if line.target else "",
            verdict,
        )
    return table


def line_record(line: Line) -> dict[str, Any]:
    """Return a line for JSON."""
    return {
        "name": line.name,
        "unit": line.unit,
        "median": line.median,
        "least": min(line.figures),
        "greatest": max(line.figures),
        "repetitions": len(line.figures),
        "target": line.target.text if line.target else None,
        "is_met": line.is_met,
    }


def _short(figure: float) -> str:
    return f"{figure:.3g}" if figure < 1000.0 else f"{figure:.0f}"


def steal_text(fraction: float | None) -> str:
    """Return how much processor time the host gave to other guests; None: it is not reported."""
    return "steal unknown" if fraction is None else f"{100 * fraction:.1f} % stolen by the host"
