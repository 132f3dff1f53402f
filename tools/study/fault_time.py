"""The study of fault times: a table, a file and a picture."""

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from ...closed_loop.reports.plot_style import LINES, plot_style
from ...closed_loop.studies.fault_time.longest_time import longest_time_s
from ...closed_loop.studies.fault_time.settings import (
    Case,
    FallbackName,
    FaultTimeSettings,
    cases_of,
    read_fault_time,
)
from .own_kinds import Results

Times = Mapping[Case, float]


def read(file: Path) -> tuple[FaultTimeSettings, str]:
    """Return the settings, and the size of the study; raises SettingsError."""
    settings = read_fault_time(file)
    return settings, f"cases: {sum(1 for _ in cases_of(settings))}"


def results_of(settings: FaultTimeSettings) -> Results:
    """Compute the times."""
    times = {case: longest_time_s(settings, case) for case in cases_of(settings)}
    rows = [(*case, time_s) for case, time_s in times.items()]
    head = (*Case._fields, "longest_time_s")
    return Results(lines_of(settings, times), [head, *rows], picture_of(settings, times))


def _text(settings: FaultTimeSettings, time_s: float) -> str:
    if math.isnan(time_s):
        return "-"
    return f"> {settings.time_s_max:g}" if math.isinf(time_s) else f"{time_s:.2f}"


def lines_of(settings: FaultTimeSettings, times: Times) -> list[str]:
    """Return a table for each road and fallback, and which fallback leaves its lane last."""
    lines = ["longest time of a fault [s]"]
    for fallback in settings.fallbacks:
        for road in dict.fromkeys(case.road for case in times):
            own = {c: t for c, t in times.items() if (c.road, c.fallback) == (road, fallback)}
            speeds = dict.fromkeys(case.speed_km_h for case in own)
            heads = "".join(f"{speed:>8g}" for speed in speeds)
            lines += ["", f"{road}, {fallback}", f"{'km/h':<13}{heads}"]
            for fault in settings.faults:
                cells = [_text(settings, t) for case, t in own.items() if case.fault is fault]
                lines.append(f"{fault:<13}" + "".join(f"{cell:>8}" for cell in cells))
    lines += [
        "",
        "> : stays after every time tried; 0.00: leaves though the steering reacts at once;",
    ]
    lines += ["- : leaves its lane without a fault"]
    for speed in sorted({case.speed_km_h for case in times}):
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
        most = f"{settings.time_s_max:g}: or longer"
        axes[0, 0].set_ylabel(f"longest time of the fault [s]\n({most})")
        axes[-1, 0].set_xlabel("speed [km/h]")
        axes[0, -1].legend(fontsize="x-small")
    return figure
