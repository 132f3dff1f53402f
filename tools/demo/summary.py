"""Figures of the demo, on the bus and in virtual time, as a table and as JSON."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from rich import box
from rich.table import Table

from ...pair.live import PairResult


class Figures(NamedTuple):
    """Figures of one run."""

    lateral_error_rms_m: float
    lateral_error_peak_m: float
    steer_peak_rad: float
    latency_p50_s: float  # injected into the commands that were not lost
    latency_p99_s: float
    round_trip_p50_s: float  # measured by the controller through the echoed counter
    round_trip_p99_s: float
    lateness_p50_s: float | None  # of the controller's ticks; virtual time is never late
    lateness_p99_s: float | None
    skipped_ticks: int
    frames_lost: int
    frames_rejected: int


class LawFigures(NamedTuple):
    """One law: the run on the bus, and the same settings and seed in virtual time."""

    label: str
    live: Figures
    virtual: Figures


def figures_of(result: PairResult) -> Figures:
    """Collect the figures of one run from the reports of its two nodes."""
    plant, controller = result.plant["node"], result.controller["node"]
    latency, round_trip = plant["downlink"]["injected"], controller["round_trip"]
    lateness = result.controller["loop"]["lateness"] if "loop" in result.controller else None
    return Figures(
        lateral_error_rms_m=plant["lateral_error_rms_m"],
        lateral_error_peak_m=plant["lateral_error_peak_m"],
        steer_peak_rad=plant["wheel_angle_peak_rad"],
        latency_p50_s=latency["p50_s"],
        latency_p99_s=latency["p99_s"],
        round_trip_p50_s=round_trip["p50_s"],
        round_trip_p99_s=round_trip["p99_s"],
        lateness_p50_s=lateness and lateness["p50_s"],
        lateness_p99_s=lateness and lateness["p99_s"],
        skipped_ticks=controller["skipped_ticks"],
        frames_lost=plant["downlink"]["lost"] + plant["uplink"]["lost"],
        frames_rejected=sum(plant["rejected"].values()) + sum(controller["rejected"].values()),
    )


def summary_table(rows: Sequence[LawFigures]) -> Table:
    """Return the table that is printed: a column a run, so that it fits a terminal's 80 columns."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column()
    for row in rows:
        table.add_column(f"{row.label}\non the bus", justify="right", no_wrap=True)
        table.add_column("virtual\ntime", justify="right", no_wrap=True, style="dim")
    runs = [figures for row in rows for figures in (row.live, row.virtual)]
    for heading, cell in _LINES.items():
        table.add_row(heading, *(cell(figures) for figures in runs))
    return table


def summary_json(
    rows: Sequence[LawFigures], run: Mapping[str, Any], reports: Mapping[str, PairResult]
) -> dict[str, Any]:
    """Return all figures for programs to read; ``run`` describes what was run and on what."""
    return {
        "run": dict(run),
        "laws": {
            row.label: {
                "on_the_bus": row.live._asdict(),
                "virtual_time": row.virtual._asdict(),
                "rms_ratio": row.live.lateral_error_rms_m / row.virtual.lateral_error_rms_m,
            }
            for row in rows
        },
        "reports": {
            label: {"plant_emulator": result.plant, "controller": result.controller}
            for label, result in reports.items()
        },
    }


def _pair(p50_s: float | None, p99_s: float | None, digits: int) -> str:
    """Return two times in milliseconds, or a dash where there are none."""
    if p50_s is None or p99_s is None:
        return "-"
    return f"{1e3 * p50_s:.{digits}f}/{1e3 * p99_s:.{digits}f}"


_LINES: Mapping[str, Callable[[Figures], str]] = {
    "RMS error [mm]": lambda run: f"{1e3 * run.lateral_error_rms_m:.1f}",
    "peak error [mm]": lambda run: f"{1e3 * run.lateral_error_peak_m:.1f}",
    "max steer [rad]": lambda run: f"{run.steer_peak_rad:.3f}",
    "latency [ms]": lambda run: _pair(run.latency_p50_s, run.latency_p99_s, 0),
    "round trip [ms]": lambda run: _pair(run.round_trip_p50_s, run.round_trip_p99_s, 0),
    "lateness [ms]": lambda run: _pair(run.lateness_p50_s, run.lateness_p99_s, 2),
    "skipped ticks": lambda run: str(run.skipped_ticks),
    "frames lost": lambda run: str(run.frames_lost),
    "frames rejected": lambda run: str(run.frames_rejected),
}
"""Lines of the table: a heading, and the text of one run."""
