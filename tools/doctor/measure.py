"""Measure how punctual this machine is, how fast its bus is, and which rate it can keep.

    steer-by-wire probe [-i INTERFACE -c CHANNEL] [--seconds SECONDS] [--json FILE]

Measures twice: as an ordinary program, and with the real-time rights that the host grants. Without
``-i`` the bus is chosen as the programs choose it; if that is the emulated bus and none is running,
the probe starts its own. On the bus it sends only its own requests and echoes, 0x7FE and 0x7FF, a
hundred a second each. docs/real_time.md explains how to read the result.
"""

import argparse
import platform
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from steer_by_wire.runtime.command_line import command_parser, seconds
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from steer_by_wire.runtime.node.statistics import DurationSummary, durations_report
from steer_by_wire.runtime.port.python_can import add_bus_arguments
from steer_by_wire.runtime.program.node_options import add_real_time_arguments
from steer_by_wire.runtime.program.option_types import add_json_argument
from steer_by_wire.runtime.program.program import ExitStatus, run_main, say
from steer_by_wire.runtime.program.report import write_json
from steer_by_wire.tools.doctor.probe import REAL_TIME, Measured, Probe, RoundTrip, probe, steps
from steer_by_wire.tools.doctor.wake_ups import Figures, WakeUps

NAME = "steer-by-wire probe"
WIDTH_MIN = 95
"""Width of the table, whose figures are no use cut short."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the probe; returns the exit status, which does not depend on the verdict."""
    parser = command_parser(NAME, __doc__, f"{NAME} --json probe.json")
    parser.add_argument(
        "--seconds",
        type=seconds,
        default=1.0,
        help="duration of each measurement (default: %(default)g)",
    )
    add_json_argument(parser)
    add_real_time_arguments(parser)
    add_bus_arguments(parser)
    parser.add_argument(
        "--no-fast-socketcan",
        dest="fast_socketcan",
        action="store_false",
        help="use python-can for SocketCAN too",
    )
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    result = _probe_with_progress(options)
    console = Console(markup=False, highlight=False)
    console.width = max(console.width, WIDTH_MIN)
    console.print(
        f"bus: {result.bus}\n"
        f"{platform.python_implementation()} {platform.python_version()}, {platform.platform()}",
        soft_wrap=True,
    )
    console.print(table_of(result.measured))
    for sentence in sentences(result):
        console.print(sentence, soft_wrap=True)
    if options.json is not None:
        write_json(options.json, record_of(result))
    return ExitStatus.OK


def _probe_with_progress(options: argparse.Namespace) -> Probe:
    console = Console(stderr=True)
    if not console.is_terminal:
        return probe(options, lambda what: say(NAME, what, sys.stderr))
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("opening the bus", total=steps(options))
        begun = False

        def report(what: str) -> None:
            nonlocal begun
            progress.update(task, description=what, advance=int(begun))
            begun = True

        return probe(options, report)


LATENESS_SHARE_MAX = 0.1
"""Share of the period, for 99 of 100 wake-ups: beyond it, the law's samples are no longer equally
spaced."""
DONE_SHARE_MAX = 0.5
"""Share of the period, for 99 of 100 ticks: the other half is for frames, and a reserve."""
UNDISTURBED_SHARE_MIN = 0.5
"""Share of all periods; with fewer, stolen time is the normal state of this machine."""
MISSED_SHARE_MAX = 0.001
"""Share of all periods: any machine stalls at times, and a controller continues on its grid."""
RULE = (
    "a rate is kept if at most one period in a thousand is missed, 99 of 100 wake-ups are late by "
    "at most a tenth of the period, and 99 of 100 ticks are done within half of it; slices in "
    "which the host took time are left out unless they are most"
)


def judged(wake_ups: WakeUps) -> Figures:
    """Return the figures that count."""
    samples = wake_ups.everything.lateness.samples
    enough = wake_ups.undisturbed.lateness.samples >= UNDISTURBED_SHARE_MIN * samples
    return wake_ups.undisturbed if enough else wake_ups.everything


def is_kept(wake_ups: WakeUps) -> bool:
    """Whether the machine keeps this rate."""
    figures, period_ns = judged(wake_ups), NS_PER_S / wake_ups.rate_hz
    served = figures.lateness.samples
    return (
        served > 0
        and figures.missed <= MISSED_SHARE_MAX * (served + figures.missed)
        and figures.lateness.p99_ns <= LATENESS_SHARE_MAX * period_ns
        and figures.done.p99_ns <= DONE_SHARE_MAX * period_ns
    )


def rate_kept_hz(measurements: Sequence[WakeUps]) -> int | None:
    """Return the highest rate that is kept together with all lower ones; None without any."""
    kept = None
    for wake_ups in sorted(measurements, key=lambda each: each.rate_hz):
        if not is_kept(wake_ups):
            break
        kept = wake_ups.rate_hz
    return kept


UNDISTURBED = "  where nothing was stolen"


def table_of(measured: Sequence[Measured]) -> Table:
    """Return everything measured, in milliseconds; disturbed measurements have a second row."""
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
            table.add_row(name, *_wake_up_cells(wake_ups.everything), steal, kept)
            if wake_ups.steal_fraction:
                table.add_row(UNDISTURBED, *_wake_up_cells(wake_ups.undisturbed))
        trip = each.round_trip
        if trip is not None:
            cells = (*_cells(trip.everything), "", str(trip.unanswered))
            table.add_row(f"round trip, {each.rights}", *cells, _percent(trip.steal_fraction))
            if trip.steal_fraction:
                table.add_row(UNDISTURBED, *_cells(trip.undisturbed))
        table.add_section()
    return table


def sentences(probe: Probe) -> Iterator[str]:
    """Return the rest for people, line by line; the verdict is last."""
    for measured in probe.measured:
        if measured.obstacle:
            yield f"no round trip, {measured.rights}: {measured.obstacle}"
        elif measured.round_trip is not None and not measured.round_trip.everything.samples:
            yield f"no echo, {measured.rights}: is there anybody to acknowledge frames?"
    if probe.refused:
        yield f"no measurement with real-time rights: {probe.refused}"
    for answer in probe.measured[-1].answers:
        yield f"{answer.name}: {'' if answer.got else 'refused, '}{answer.detail}"
    yield f"rule: {RULE}"
    for measured in probe.measured:
        yield f"verdict, {measured.rights}: {_verdict(measured)}"


def record_of(probe: Probe) -> dict[str, Any]:
    """Return everything for JSON, times in seconds."""
    return {
        "bus": probe.bus,
        "driver": probe.driver,
        "real_time_refused": probe.refused or None,
        "rule": RULE,
        "measured": [_measured_record(measured) for measured in probe.measured],
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
        "answers": [answer._asdict() for answer in measured.answers],
        "rate_kept_hz": rate_kept_hz(measured.wake_ups),
        "wake_ups": [_wake_ups_record(wake_ups) for wake_ups in measured.wake_ups],
        "round_trip": _round_trip_record(measured.round_trip),
        "round_trip_obstacle": measured.obstacle or None,
    }


def _wake_ups_record(wake_ups: WakeUps) -> dict[str, Any]:
    return {
        "rate_hz": wake_ups.rate_hz,
        "is_kept": is_kept(wake_ups),
        "judged_by": "undisturbed" if judged(wake_ups) is wake_ups.undisturbed else "everything",
        "everything": _figures_record(wake_ups.everything),
        "undisturbed": _figures_record(wake_ups.undisturbed),
        "steal_fraction": wake_ups.steal_fraction,
    }


def _figures_record(figures: Figures) -> dict[str, Any]:
    return {
        "lateness": durations_report(figures.lateness),
        "done": durations_report(figures.done),
        "missed": figures.missed,
    }


def _round_trip_record(trip: RoundTrip | None) -> dict[str, Any] | None:
    if trip is None:
        return None
    return {
        "everything": durations_report(trip.everything),
        "undisturbed": durations_report(trip.undisturbed),
        "unanswered": trip.unanswered,
        "steal_fraction": trip.steal_fraction,
    }


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


if __name__ == "__main__":
    sys.exit(main())
