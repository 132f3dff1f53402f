"""A soak as text and as JSON."""

from collections.abc import Iterator, Sequence
from typing import Any

from rich.table import Table

from ...terminal import plain_table
from .live import CHANNEL, LiveSoak
from .verdict import Finding, bounds_ns


def findings_table(title: str, findings: Sequence[Finding]) -> Table:
    """Return what was to be shown, and whether it was."""
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for name in ("", "", "measured"):
        table.add_column(name)
    for finding in findings:
        table.add_row("ok" if finding.holds else "NO", finding.what, finding.figure)
    return table


def messages_table(run: LiveSoak) -> Table:
    """Return the figures of each message; times in microseconds."""
    counts = ("id", "sent", "on bus", "lost", "reord.", "taken", "missed")
    headings = (*counts, "p50", "p99", "max", "bound", "handed p99", "max")
    title = "frames, and their delay before the start of frame [us]"
    table = plain_table([""], headings, title)
    for row in _rows(run):
        arbitration, handed = row["arbitration"], row["handed_over"]
        table.add_row(
            row["name"],
            f"0x{row['can_id']:03X}",
            *(str(row[key]) for key in ("sent", "on_bus", "lost", "reordered", "taken", "missed")),
            *(_us(arbitration[key]) for key in ("p50_s", "p99_s", "max_s", "bound_s")),
            *(_us(handed[key]) for key in ("p99_s", "max_s")),
        )
    return table


def _us(time_s: float | None) -> str:
    """Return a time in microseconds; a dash where there is no bound."""
    return "-" if time_s is None else f"{1e6 * time_s:.0f}"


def memory_table(run: LiveSoak) -> Table:
    """Return the resident memory of each process [KiB]."""
    headings = ("start", "middle", "end", "growth", "slope per minute")
    table = plain_table([""], headings, "memory [KiB]")
    for name, figures in run.memory.items():
        table.add_row(
            name,
            *(str(kib) for kib in figures[:3]),
            f"{figures.growth_kib:+.0f}",
            f"{figures.slope_kib_min:+.1f}",
        )
    return table


def record_of(run: LiveSoak, findings: Sequence[Finding]) -> dict[str, Any]:
    """Return all figures of one run for JSON."""
    bus = run.bus._asdict()
    bus["control"] = {f"{can_id:03X}": len(frames) for can_id, frames in run.bus.control.items()}
    return {
        "plan": {**run.plan._asdict(), "bus": run.plan.bus.model_dump(mode="json")},
        "findings": [finding._asdict() for finding in findings],
        "bus": bus,
        "messages": list(_rows(run)),
        "modes": run.modes,
        "memory": {name: figures._asdict() for name, figures in run.memory.items()},
        "memory_samples": dict(run.memory_samples),
        "reports": dict(run.reports),
    }


def _rows(run: LiveSoak) -> Iterator[dict[str, Any]]:
    delays = run.reports["broker"]["channels"][CHANNEL]["arbitration_delay"]
    bounds = bounds_ns(run)
    for message in run.messages:
        arbitration = dict(delays[f"{message.can_id:03X}"])
        bound_ns = bounds.get(message.can_id)
        arbitration["bound_s"] = None if bound_ns is None else bound_ns * 1e-9
        waited = message.waited
        yield {
            **{key: value for key, value in message._asdict().items() if key != "waited"},
            "arbitration": arbitration,
            "handed_over": {
                "p50_s": waited.p50_ns * 1e-9,
                "p99_s": waited.p99_ns * 1e-9,
                "max_s": waited.max_ns * 1e-9,
            },
        }
