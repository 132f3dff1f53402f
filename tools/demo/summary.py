"""Figures of the demo, on the bus and in virtual time: tables, what they show, and JSON."""

from collections.abc import Mapping, Sequence
from operator import itemgetter
from types import MappingProxyType
from typing import Any

from rich import box
from rich.table import Table

from ...runtime.thresholds import Quantity
from .story import LawResult, Phase, PhaseFigures


def story_table(results: Sequence[LawResult], phases: Sequence[Phase]) -> Table:
    """Return RMS error and verdict: a row a law, a column a phase; it fits 80 columns."""
    table = _table()
    table.add_column("RMS error [mm],\npreview point")
    for phase in phases:
        table.add_column(phase.title.replace(", ", ",\n"), justify="right", no_wrap=True)
    for result in results:
        table.add_row(result.label, *(_mm(phase.rms_m) for phase in result.live_phases))
        virtual = (_mm(phase.rms_m) for phase in result.virtual_phases)
        table.add_row("  in virtual time", *virtual, style="dim")
        of_cg = (_mm(phase.cg_rms_m) for phase in result.live_phases)
        table.add_row("  centre of gravity", *of_cg)
        table.add_row("  verdict", *(str(phase.verdict) for phase in result.live_phases))
    return table


def machine_table(results: Sequence[LawResult]) -> Table:
    """Return rate, lateness, skipped ticks and rejected frames, a row a law."""
    table = _table()
    table.add_column("on the bus")
    for heading in ("rate\n[Hz]", "lateness [ms]\np50/p99", "skipped\nticks", "frames\nrejected"):
        table.add_column(heading, justify="right", no_wrap=True)
    for result in results:
        controller = result.live.controller
        lateness = controller["loop"]["lateness"]
        table.add_row(
            result.label,
            f"{controller['node']['rate_hz']:g}",
            f"{1e3 * lateness['p50_s']:.2f}/{1e3 * lateness['p99_s']:.2f}",
            str(controller["node"]["skipped_ticks"]),
            str(_rejected(result)),
        )
    return table


def what_to_see(results: Sequence[LawResult], phases: Sequence[Phase]) -> list[str]:
    """Return a sentence for each law that says in which phase it breaks."""
    return [f"{result.label}: {_fate(result.live_phases, phases)}" for result in results]


def _fate(figures: Sequence[PhaseFigures], phases: Sequence[Phase]) -> str:
    broken = [index for index, phase in enumerate(figures) if not phase.holds]
    if not broken:
        worst_m = max(phase.rms_m for phase in figures)
        return f"holds the path to the end, with {_mm(worst_m)} mm at most."
    first = broken[0]
    held = " and ".join(phase.title for phase in phases[:first])
    before = f"holds the path with {held}; " if held else ""
    return f"{before}breaks with {phases[first].title} ({figures[first].verdict})."


def verdict_line(results: Sequence[LawResult]) -> str:
    """Return whether the bus shows what virtual time does."""
    phases = sum(len(result.live_phases) for result in results)
    alike = phases - differing_phases(results)
    return (
        f"verdict: in {alike} of {phases} phases the path is held, or not, as in virtual time; "
        f"where it is held, the RMS errors differ by {_mm(rms_difference_m(results))} mm at most"
    )


def differing_phases(results: Sequence[LawResult]) -> int:
    """Return in how many phases only one of the two, bus and virtual time, holds the path."""
    return sum(live.holds != virtual.holds for live, virtual in _pairs(results))


def rms_difference_m(results: Sequence[LawResult]) -> float:
    """Return how far apart the RMS errors of the two are at most, where both hold the path [m]."""
    return max(
        (abs(live.rms_m - virtual.rms_m) for live, virtual in _pairs(results) if live.holds),
        default=0.0,
    )


QUANTITIES: Mapping[str, Quantity] = MappingProxyType(
    {
        name: Quantity(itemgetter(name))
        for name in (
            *("differing_phases", "rms_difference_m"),
            *("lateness_p99_s", "skipped_ticks", "frames_rejected"),
        )
    }
)
"""What ``--fail-if`` may name; lateness, ticks and frames are the worst of all pairs."""


def summary_json(
    results: Sequence[LawResult], phases: Sequence[Phase], run: Mapping[str, Any]
) -> dict[str, Any]:
    """Return all figures for programs to read; ``run`` describes what was run and on what."""
    controllers = [result.live.controller for result in results]
    return {
        "run": dict(run),
        "differing_phases": differing_phases(results),
        "rms_difference_m": rms_difference_m(results),
        "lateness_p99_s": max(one["loop"]["lateness"]["p99_s"] for one in controllers),
        "skipped_ticks": max(one["node"]["skipped_ticks"] for one in controllers),
        "frames_rejected": max(map(_rejected, results)),
        "phases": [phase._asdict() for phase in phases],
        "laws": {
            result.label: {
                "on_the_bus": [figures._asdict() for figures in result.live_phases],
                "virtual_time": [figures._asdict() for figures in result.virtual_phases],
            }
            for result in results
        },
        "reports": {
            result.label: {
                "plant_emulator": result.live.plant,
                "controller": result.live.controller,
            }
            for result in results
        },
    }


def _pairs(results: Sequence[LawResult]) -> list[tuple[PhaseFigures, PhaseFigures]]:
    return [
        pair
        for result in results
        for pair in zip(result.live_phases, result.virtual_phases, strict=True)
    ]


def _rejected(result: LawResult) -> int:
    reports = (result.live.plant, result.live.controller)
    return sum(sum(report["node"]["rejected"].values()) for report in reports)


def _table() -> Table:
    return Table(box=box.SIMPLE_HEAD, padding=(0, 2, 0, 0), pad_edge=False)


def _mm(value_m: float) -> str:
    return f"{1e3 * value_m:.1f}"
