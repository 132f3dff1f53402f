"""The study of fault times: its cases on worker processes, a table, a file and a picture."""

import argparse
import csv
import io
import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from ...closed_loop.processes.parallel_work import worker_pool
from ...closed_loop.reports.plot_style import LINES, plot_style, png_of
from ...closed_loop.reports.terminal import plain_console
from ...closed_loop.studies.fault_time.longest_time import longest_time_s
from ...closed_loop.studies.fault_time.settings import (
    Case,
    FallbackName,
    FaultTimeSettings,
    cases_of,
    read_fault_time,
)
from ...runtime.exit_status import ExitStatus
from ...runtime.output_file import write_file, write_text
from ...runtime.settings import SettingsError

Times = Mapping[Case, float]


def run_fault_time(options: argparse.Namespace) -> int:
    """Compute the times, print their table, and write fault_time.csv and .png."""
    if options.replay is not None or options.scheduler:
        raise SettingsError(f"{options.study}: fault times have neither --replay nor --scheduler")
    settings = read_fault_time(options.study)
    cases = list(cases_of(settings))
    print_line = plain_console().print
    print_line(f"study: fault_time: {settings.title}")
    print_line(f"cases: {len(cases)}, each of 2 to {_runs_max(settings)} runs")
    if options.dry_run:
        return ExitStatus.OK
    times = _computed(settings, cases, options.workers or os.cpu_count() or 1, print_line)
    for line in lines_of(settings, times):
        print_line(line)
    folder = options.out or Path("out/study/fault_time")
    folder.mkdir(parents=True, exist_ok=True)
    rows = io.StringIO(newline="")
    writer = csv.writer(rows, lineterminator="\n")
    writer.writerow((*Case._fields, "longest_time_s"))
    writer.writerows((*case, time_s) for case, time_s in times.items())
    write_text(folder / "fault_time.csv", rows.getvalue())
    write_file(folder / "fault_time.png", png_of(picture_of(settings, times)))
    print_line(f"results: {folder / 'fault_time.csv'}, {folder / 'fault_time.png'}")
    return ExitStatus.OK


def _runs_max(settings: FaultTimeSettings) -> int:
    return 3 + math.ceil(math.log2(settings.time_s_max / settings.resolution_s))


def _computed(
    settings: FaultTimeSettings,
    cases: Sequence[Case],
    workers: int,
    print_line: Callable[[str], Any],
) -> Times:
    times: dict[Case, float] = dict.fromkeys(cases, math.nan)
    if workers == 1:
        return {case: longest_time_s(settings, case) for case in cases}
    with worker_pool(min(workers, len(cases))) as pool:
        futures = {pool.submit(partial(longest_time_s, settings, case)): case for case in cases}
        for done, future in enumerate(as_completed(futures), start=1):
            times[futures[future]] = future.result()
            if done % 24 == 0:
                print_line(f"{done} of {len(cases)} cases")
    return times


def _text(settings: FaultTimeSettings, time_s: float) -> str:
    if math.isnan(time_s):
        return "-"
    return f"> {settings.time_s_max:g}" if math.isinf(time_s) else f"{time_s:.2f}"


def lines_of(settings: FaultTimeSettings, times: Times) -> list[str]:
    """Return a table for each fallback, and which fallback leaves its lane last."""
    roads = list(dict.fromkeys((case.road, case.speed_km_h) for case in times))
    lines = []
    for fallback in settings.fallbacks:
        heads = [f"{road}, {speed:g} km/h" for road, speed in roads]
        lines += ["", f"longest time [s], fallback {fallback}", " " * 14 + "  ".join(heads)]
        for fault in settings.faults:
            row = {(c.road, c.speed_km_h): t for c, t in times.items()
                   if (c.fault, c.fallback) == (fault, fallback)}  # fmt: skip
            cells = [_text(settings, row[road]).rjust(len(head))
                     for road, head in zip(roads, heads, strict=True)]  # fmt: skip
            lines.append(f"{fault:<14}" + "  ".join(cells))
    lines += ["", "> : stays after the longest time tried; 0.00: leaves though it reacts at once;"]
    lines += ["- : leaves its lane without a fault"]
    for speed in dict.fromkeys(speed for _, speed in roads):
        last = max(settings.fallbacks, key=partial(_held_s, settings, times, speed))
        lines.append(f"at {speed:g} km/h the fallback that leaves the lane last: {last}")
    return lines


def _held_s(
    settings: FaultTimeSettings, times: Times, speed_km_h: float, fallback: FallbackName
) -> float:
    """Return the sum of the times of a fallback at a speed, none above the longest tried."""
    own = [t for c, t in times.items() if (c.fallback, c.speed_km_h) == (fallback, speed_km_h)]
    return sum(min(time_s, settings.time_s_max) for time_s in own if not math.isnan(time_s))


def picture_of(settings: FaultTimeSettings, times: Times) -> Figure:
    """Return the times over speed: a column for each fallback, a row for each kind of road."""
    scenes = {scene.name for scene in settings.scenes}
    rows = list(dict.fromkeys(case.road for case in times if case.road not in scenes))
    with plot_style():
        figure = Figure(figsize=(3.2 * len(settings.fallbacks), 2.8 * len(rows)))
        axes = figure.subplots(
            len(rows), len(settings.fallbacks), sharex=True, sharey=True, squeeze=False
        )
        for row, road in zip(axes, rows, strict=True):
            for ax, fallback in zip(row, settings.fallbacks, strict=True):
                for fault, line in zip(settings.faults, LINES, strict=False):
                    points = [
                        (case.speed_km_h, min(time_s, settings.time_s_max))
                        for case, time_s in times.items()
                        if (case.road, case.fallback, case.fault) == (road, fallback, fault)
                    ]
                    ax.plot(*zip(*points, strict=True), label=fault, marker=".", **line)
                ax.set_title(f"{fallback}\n{road}", fontsize="small")
        axes[0, 0].set_ylabel("longest time of the fault [s]")
        axes[-1, 0].set_xlabel("speed [km/h]")
        axes[0, -1].legend(fontsize="x-small")
    return figure
