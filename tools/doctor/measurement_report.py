"""Which rate this machine can keep, by what was measured, as a table, sentences and JSON."""

import argparse
import platform
import sys
from collections.abc import Iterator, Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from ...runtime.command_line import say
from ...runtime.node import NS_PER_MS
from ...runtime.node.statistics import DurationSummary, durations_report
from .kept_rate import RULE, is_kept, rate_kept_hz
from .measurement import REAL_TIME, Measured, Measurement, measure, steps
from .wake_ups import Figures

WIDTH_MIN = 95
"""Width of the table, whose figures are no use cut short."""


def measure_with_progress(options: argparse.Namespace, name: str) -> Measurement:
    """Measure, and show how far it is; ``name`` of the program begins its lines."""
    console = Console(stderr=True)
    if not console.is_terminal:
        return measure(options, lambda what: say(name, what, sys.stderr))
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("opening the bus", total=steps(options))
        begun = False

        def report(what: str) -> None:
            nonlocal begun
            progress.update(task, description=what, advance=int(begun))
            begun = True

        return measure(options, report)


def show(measured: Measurement) -> None:
    """Print the table, and what it means."""
    console = Console(markup=False, highlight=False)
    console.width = max(console.width, WIDTH_MIN)
    console.print(
        f"bus: {measured.bus}\n"
        f"{platform.python_implementation()} {platform.python_version()}, {platform.platform()}",
        soft_wrap=True,
    )
    console.print(table_of(measured.measured))
    for sentence in sentences(measured):
        console.print(sentence, soft_wrap=True)


def table_of(measured: Sequence[Measured]) -> Table:
    """Return everything measured, in milliseconds."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("times in ms", no_wrap=True)
    for heading in ("samples", "p50", "p99", "max", "done p99", "missed", "stolen"):
        table.add_column(heading, justify="right", no_wrap=True, min_width=len(heading))
    table.add_column("kept", no_wrap=True)
    for each in measured:
        for wake_ups in each.wake_ups:
            name = f"wake-up, {wake_ups.rate_hz} Hz, {each.rights}"
            kept = "yes" if is_kept(wake_ups) else "no"
            steal = _percent(wake_ups.steal_fraction)
            table.add_row(name, *_wake_up_cells(wake_ups.figures), steal, kept)
        trip = each.round_trip
        if trip is not None:
            cells = (*_cells(trip.times), "", str(trip.unanswered))
            table.add_row(f"round trip, {each.rights}", *cells, _percent(trip.steal_fraction))
        table.add_section()
    return table


def sentences(measurement: Measurement) -> Iterator[str]:
    """Return the rest for people, line by line; the verdict is last."""
    for measured in measurement.measured:
        if measured.obstacle:
            yield f"no round trip, {measured.rights}: {measured.obstacle}"
        elif measured.round_trip is not None and not measured.round_trip.times.samples:
            yield f"no echo, {measured.rights}: is there anybody to acknowledge frames?"
    if measurement.refused:
        yield f"no measurement with real-time rights: {measurement.refused}"
    for answer in measurement.measured[-1].answers:
        yield f"{answer.name}: {'' if answer.got else 'refused, '}{answer.detail}"
    yield f"rule: {RULE}"
    for measured in measurement.measured:
        yield f"verdict, {measured.rights}: {_verdict(measured)}"


def record_of(measurement: Measurement) -> dict[str, Any]:
    """Return everything for JSON, times in seconds."""
    return {
        "bus": measurement.bus,
        "driver": measurement.driver,
        "real_time_refused": measurement.refused or None,
        "rule": RULE,
        "measured": [_measured_record(measured) for measured in measurement.measured],
    }


def _verdict(measured: Measured) -> str:
    kept_hz = rate_kept_hz(measured.wake_ups)
    if kept_hz is None:
        slowest_hz = min(wake_ups.rate_hz for wake_ups in measured.wake_ups)
        return f"this machine keeps not even {slowest_hz} Hz"
    return f"this machine keeps a controller at {kept_hz} Hz"


def _measured_record(measured: Measured) -> dict[str, Any]:
    return {
        "rights": measured.rights,
        "is_real_time": measured.rights == REAL_TIME,
        "answers": _plain(measured.answers),
        "rate_kept_hz": rate_kept_hz(measured.wake_ups),
        "wake_ups": [{**_plain(one), "is_kept": is_kept(one)} for one in measured.wake_ups],
        "round_trip": _plain(measured.round_trip),
        "round_trip_obstacle": measured.obstacle or None,
    }


def _plain(value: Any) -> Any:
    """Return records as dictionaries by their fields, summaries of durations in seconds."""
    if isinstance(value, DurationSummary):
        return durations_report(value)
    if isinstance(value, list):
        return [_plain(one) for one in value]
    fields = value._asdict().items() if hasattr(value, "_asdict") else None
    return value if fields is None else {name: _plain(one) for name, one in fields}


def _wake_up_cells(figures: Figures) -> tuple[str, ...]:
    done = _milliseconds(figures.done.p99_ns)
    return (*_cells(figures.lateness), done, str(figures.missed))


def _cells(summary: DurationSummary) -> tuple[str, ...]:
    times = (summary.p50_ns, summary.p99_ns, summary.max_ns)
    return (str(summary.samples), *(_milliseconds(ns) for ns in times))


def _milliseconds(duration_ns: int) -> str:
    return f"{duration_ns / NS_PER_MS:.3f}"


def _percent(fraction: float | None) -> str:
    return "unknown" if fraction is None else f"{100 * fraction:.1f} %"
