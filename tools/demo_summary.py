"""Figures of the demo: one row a law on the bus and one in virtual time, as table and as JSON."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from rich.table import Table

from tools.live_pair import PairResult


class Figures(NamedTuple):
    """What is told of one run."""

    lateral_error_rms_m: float
    lateral_error_peak_m: float
    steer_peak_rad: float
    latency_p50_s: float
    latency_p99_s: float
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
    latency = plant["downlink"]["latency"]
    lateness = result.controller["loop"]["lateness"] if "loop" in result.controller else None
    return Figures(
        lateral_error_rms_m=plant["lateral_error_rms_m"],
        lateral_error_peak_m=plant["lateral_error_peak_m"],
        steer_peak_rad=plant["wheel_angle_peak_rad"],
        latency_p50_s=latency["p50_s"],
        latency_p99_s=latency["p99_s"],
        lateness_p50_s=lateness and lateness["p50_s"],
        lateness_p99_s=lateness and lateness["p99_s"],
        skipped_ticks=controller["skipped_ticks"],
        frames_lost=plant["downlink"]["lost"] + plant["uplink"]["lost"],
        frames_rejected=sum(plant["rejected"].values()) + sum(controller["rejected"].values()),
    )


def summary_table(rows: Sequence[LawFigures]) -> Table:
    """Return the table that is printed."""
    table = Table(title="Three laws over the same latency", title_justify="left")
    table.add_column("law")
    table.add_column("run")
    for heading in (
        "RMS\n[mm]",
        "peak\n[mm]",
        "peak steer\n[rad]",
        "latency\np50/p99 [ms]",
        "lateness\np50/p99 [ms]",
        "skipped\nticks",
        "frames\nlost",
        "frames\nrejected",
    ):
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(row.label, "on the bus", *_cells(row.live))
        table.add_row("", "virtual time", *_cells(row.virtual), style="dim", end_section=True)
    return table


def summary_json(
    rows: Sequence[LawFigures], run: Mapping[str, Any], reports: Mapping[str, PairResult]
) -> dict[str, Any]:
    """Return everything a program would want to read; ``run`` says what was run and on what."""
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


def _cells(figures: Figures) -> list[str]:
    late = "-"
    if figures.lateness_p50_s is not None and figures.lateness_p99_s is not None:
        late = f"{1e3 * figures.lateness_p50_s:.2f} / {1e3 * figures.lateness_p99_s:.2f}"
    return [
        f"{1e3 * figures.lateral_error_rms_m:.1f}",
        f"{1e3 * figures.lateral_error_peak_m:.1f}",
        f"{figures.steer_peak_rad:.3f}",
        f"{1e3 * figures.latency_p50_s:.0f} / {1e3 * figures.latency_p99_s:.0f}",
        late,
        str(figures.skipped_ticks),
        str(figures.frames_lost),
        str(figures.frames_rejected),
    ]
