"""The figures of the analysed logs: in the terminal, a column for each log, and for --fail-if."""

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...plant_emulator.command_line import fail_if_quantities
from ...runtime.program.fail_if_conditions import Quantity, of_part
from .report import milliseconds

QUANTITIES: Mapping[str, Quantity] = {
    **fail_if_quantities.QUANTITIES,
    **of_part(
        {
            "round_trip_p99_s": Quantity(lambda log: log["latency"]["round_trip"]["p99_s"]),
            "missing": Quantity(lambda log: sum(m["missing"] for m in log["messages"].values())),
            "refused": Quantity(lambda log: sum(log["refused"].values())),
        },
        "log",
    ),
}
"""What ``--fail-if`` may name."""


class Result(NamedTuple):
    """The result of one log, and the folder with its files."""

    figures: dict[str, Any]
    folder: Path


def print_results(results: Sequence[Result]) -> None:
    """Print the most important figures, one column for each log."""
    table = Table(box=None, pad_edge=False)
    table.add_column("")
    for result in results:
        table.add_column(result.folder.name, justify="right", overflow="fold")
    for label, read in _ROWS.items():  # their units are in brackets, as markup would be
        table.add_row(Text(label), *(read(result.figures) for result in results))
    console = Console(width=None if sys.stdout.isatty() else 100)
    console.print(table)
    for result in results:
        figures = result.figures
        if backwards := figures["times_backwards"]:
            print(f"time runs backwards at {backwards} of {figures['frames']} frames")
        if figures["times_too_coarse"]:
            print("times are too coarse, or stand still: latencies and cycle times are unknown")
        if figures["clock_set"]:
            print(f"the clock was set {figures['clock_set']} times: that time is left out")
        if figures["unreadable"]:
            print(f"{figures['unreadable']} lines not read, the first: ", end="")
            print(figures["first_unreadable"])
        if len(figures["channels"]) > 1 and figures["latency"]["commands"]:
            print(f"several channels ({', '.join(figures['channels'])}): choose with --channel")
        if smoothed := figures.get("smoothed"):
            for name in ("delay_s", "steering_lag_s", "steering_offset_rad"):
                *words, unit = name.split("_")
                if found := smoothed.get(name):
                    mean, std = 1e3 * found["mean"], 1e3 * found["mean_std"]
                    print(f"smoothed {' '.join(words)}: {mean:.2f} ± {std:.2f} m{unit}")
        print(f"report: {result.folder / 'report.html'}")


_SPREAD = ("p50_s", "p99_s", "jitter_s")


def _ms(part: str, name: str, *keys: str) -> Callable[[dict[str, Any]], str]:
    return lambda figures: "/".join(milliseconds(figures[part][name][key]) for key in keys)


def _latency(name: str) -> Callable[[dict[str, Any]], str]:
    return _ms("latency", name, *_SPREAD)


def _intervals(name: str) -> Callable[[dict[str, Any]], str]:
    def read(figures: dict[str, Any]) -> str:
        interval = figures["latency"][name]["interval"] or {}
        ends = (interval.get(key, (None, None)) for key in _SPREAD)
        return "/".join(f"{milliseconds(low, 1)}..{milliseconds(high, 1)}" for low, high in ends)

    return read


def _missing(figures: dict[str, Any]) -> str:
    messages = figures["messages"].values()
    return f"{sum(m['missing'] for m in messages)}/{sum(m['late'] for m in messages)}"


_ROWS: dict[str, Callable[[dict[str, Any]], str]] = {
    "frames": lambda figures: str(figures["frames"]),
    "duration [s]": lambda f: "no times" if f["duration_s"] is None else f"{f['duration_s']:.2f}",
    "preview point, RMS [mm]": _ms("signals", "lateral_error_m", "rms"),
    "preview point, peak [mm]": _ms("signals", "lateral_error_m", "peak"),
    "centre of gravity, RMS [mm]": _ms("signals", "cg_deviation_m", "rms"),
    "centre of gravity, peak [mm]": _ms("signals", "cg_deviation_m", "peak"),
    "steer, RMS [mrad]": _ms("signals", "steer_rad", "rms"),
    "steer, peak [mrad]": _ms("signals", "steer_rad", "peak"),
    "round trip, p50/p99/jitter [ms]": _latency("round_trip"),
    "  of the network, 95 %": _intervals("round_trip"),
    "commands, latency, p50/p99/jitter [ms]": _latency("reported_downlink"),
    "commands, latency and wait, same [ms]": _latency("downlink"),
    "  of the network,  95 %": _intervals("downlink"),
    "measurements, latency, same [ms]": _latency("uplink"),
    "  of the network, 95 % ": _intervals("uplink"),
    "counters missing/of them late": _missing,
    "refused": lambda figures: str(sum(figures["refused"].values())),
    "foreign": lambda figures: str(figures["foreign_frames"]),
}
