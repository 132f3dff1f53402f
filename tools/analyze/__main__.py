"""Analyse logs of the bus: signals, latency and jitter, cycle times, frames lost and refused.

    steer-by-wire analyze run.log
    steer-by-wire analyze controller.blf candump-2026-11-21.log --out out/logs

Reads the formats .log .asc .blf .csv .trc of python-can, and what candump prints or logs.
For each FILE it writes a folder below --out: report.html, figures.json and signals.csv. A FILE that
cannot be read as a log is reported and skipped; the exit status is then 2. The last line is the
verdict on how the path was held, by the measured error.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

from rich.console import Console
from rich.table import Table
from rich.text import Text

from steer_by_wire.closed_loop.recordings.held_path import PREVIEW_M
from steer_by_wire.closed_loop.recordings.log_analysis import Export, analyse_files
from steer_by_wire.closed_loop.recordings.logged import LogError
from steer_by_wire.closed_loop.reports.terminal import progress_bars
from steer_by_wire.controller.filters.settings import VehicleModelSettings
from steer_by_wire.controller.settings import nominal_vehicle
from steer_by_wire.dbc.bus_language import add_dialect_argument, read_language
from steer_by_wire.plant_emulator.command_line import fail_if_quantities
from steer_by_wire.runtime.command_line import (
    add_json_argument,
    add_out_argument,
    command_parser,
    number,
    run_main,
    say,
)
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.output_file import write_text
from steer_by_wire.runtime.program.fail_if_conditions import (
    Quantity,
    add_fail_if_argument,
    fail_status,
    of_part,
)
from steer_by_wire.runtime.program.output_folder import refuse_another_run
from steer_by_wire.runtime.program.report import show_or_write, write_json
from steer_by_wire.runtime.settings import SettingsError, SharedTable, load_settings
from steer_by_wire.tools.analyze.report import milliseconds, report_html, verdict_of
from steer_by_wire.tools.analyze.signal_tables import CsvTable

if TYPE_CHECKING:
    from steer_by_wire.tools.analyze.smoothing import SmoothedTable

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
    for label, read in _ROWS:  # their units are in brackets, as markup would be
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
            print(f"clock changes: {figures['clock_set']}; the jumps in time are left out")
        if figures["unreadable"]:
            print(f"lines not read: {figures['unreadable']}, the first: ", end="")
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


_ROWS: tuple[tuple[str, Callable[[dict[str, Any]], str]], ...] = (
    ("frames", lambda figures: str(figures["frames"])),
    ("duration [s]", lambda f: "no times" if f["duration_s"] is None else f"{f['duration_s']:.2f}"),
    ("preview point, RMS [mm]", _ms("signals", "lateral_error_m", "rms")),
    ("preview point, peak [mm]", _ms("signals", "lateral_error_m", "peak")),
    ("centre of gravity, RMS [mm]", _ms("signals", "cg_deviation_m", "rms")),
    ("centre of gravity, peak [mm]", _ms("signals", "cg_deviation_m", "peak")),
    ("steer, RMS [mrad]", _ms("signals", "steer_rad", "rms")),
    ("steer, peak [mrad]", _ms("signals", "steer_rad", "peak")),
    ("round trip, p50/p99/jitter [ms]", _latency("round_trip")),
    ("  of the network, 95 %", _intervals("round_trip")),
    ("commands, latency, p50/p99/jitter [ms]", _latency("reported_downlink")),
    ("commands, latency and wait, p50/p99/jitter [ms]", _latency("downlink")),
    ("  of the network, 95 %", _intervals("downlink")),
    ("measurements, latency, p50/p99/jitter [ms]", _latency("uplink")),
    ("  of the network, 95 %", _intervals("uplink")),
    ("counters missing/of them late", _missing),
    ("refused", lambda figures: str(sum(figures["refused"].values()))),
    ("foreign", lambda figures: str(figures["foreign_frames"])),
)


NAME = "steer-by-wire analyze"
_SOURCE = "source.txt"
"""Names the files that the results in a folder are of."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    example = "steer-by-wire run --set plant.latency.downlink.mean_s=0.08 --out out/run\n"
    example += f"{NAME} out/run/candump.log"
    parser = command_parser(NAME, __doc__, example, "FILE... [options]")
    parser.add_argument(
        "files",
        nargs="+",
        type=lambda text: Path("/dev/stdin" if text == "-" else text),
        metavar="FILE",
        help="a recording, or what candump prints (-)",
    )
    add_out_argument(parser, "out/logs", "a folder for the results, with one for each FILE")
    parser.add_argument("--join", action="store_true", help="treat the files as parts of one log")
    parser.add_argument(
        "--preview-m", type=number(0.0, 100.0, "m"), default=PREVIEW_M, metavar="M",
        help="distance of the preview point ahead of the centre of gravity (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--channel", help="the channel to read, if the log has several (default: all)"
    )
    parser.add_argument(
        "--smooth", type=Path, metavar="VEHICLE.toml",
        help="also write smoothed.csv: vehicle state and disturbance, with standard deviations,"
        " of the [vehicle] in a file",
    )  # fmt: skip
    add_dialect_argument(parser, "read the messages of a car")
    add_json_argument(parser)
    add_fail_if_argument(parser, QUANTITIES)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    logs = [options.files] if options.join else [[path] for path in options.files]
    results, mistakes = [], []
    with progress_bars(Console(stderr=True)) as bars:
        bar = bars.add_task("", total=1.0)

        def advance(name: str, fraction: float | None) -> None:
            bars.update(bar, description=name, completed=fraction or 0.0)

        for paths, folder in zip(logs, _folders(logs, options.out), strict=True):
            try:
                results.append(_analyse(paths, folder, options, advance))
            except LogError as error:
                mistakes.append(str(error))
    status = ExitStatus.OK
    if results:
        figures = {result.folder.name: result.figures for result in results}
        content = results[0].figures if len(results) == 1 else figures
        show_or_write(options.json, content, partial(print_results, results))
        status = _judge(results, options)
    if mistakes:
        raise SettingsError(*mistakes)
    return status


def _judge(results: Sequence[Result], options: argparse.Namespace) -> ExitStatus:
    """Print the verdict on each log, last; returns the worst exit status."""
    status = ExitStatus.OK
    for result in results:
        report = {"node": result.figures["held_path"], "log": result.figures}
        log = f": {result.folder.name}" if len(results) > 1 else ""
        status = max(status, fail_status(f"{NAME}{log}", options.fail_if, QUANTITIES, report))
        if options.json == Path("-"):
            continue
        print(f"{log}: verdict: {verdict_of(result.figures)}".removeprefix(": "))
    return status


def _folders(logs: Sequence[Sequence[Path]], out: Path) -> list[Path]:
    """Return a folder for each log, named after its first file.

    If two names are equal, that file's folder is in all of them, and a number where it has to be.
    """
    firsts = [paths[0] for paths in logs]
    names = [first.name.split(".")[0] or first.name for first in firsts]
    if len(set(names)) < len(names):
        named = zip(firsts, names, strict=True)
        names = [f"{first.resolve().parent.name}-{name}" for first, name in named]
    return [
        out / (name if names.count(name) == 1 else f"{name}-{number}")
        for number, name in enumerate(names, start=1)
    ]


def _analyse(
    paths: Sequence[Path],
    folder: Path,
    options: argparse.Namespace,
    advance: Callable[[str, float | None], None],
) -> Result:
    """Analyse one log and write its files; without a log nothing is left or changed."""
    source = "".join(f"{path.resolve()}\n" for path in paths)
    refuse_another_run(folder, {_SOURCE: source})
    with _all_or_nothing(folder) as partial:
        with ExitStack() as stack:
            language = read_language(options.dialect)
            listening = language.listening()
            exports: list[Export] = [CsvTable(partial / "signals.csv", listening)]
            smoothed = _smoothed(partial, options.smooth) if options.smooth else None
            exports += [smoothed] if smoothed else []
            for export in exports:
                stack.callback(export.close)
            figures, analysis = analyse_files(
                paths, options.channel, exports, advance, options.preview_m, listening
            )
        foreign = (int(can_id, 16) for can_id in figures["foreign_ids"])
        for hint in language.car.of_other_addresses(foreign) if language.car else ():
            say(NAME, f"warning: {paths[0]}: {hint}", sys.stderr)
        # Only a report needs matplotlib, and an error in the file should be reported before that.
        from steer_by_wire.tools.analyze.pictures import draw_pictures

        pictures = draw_pictures(analysis, figures)
        if smoothed:
            from steer_by_wire.tools.analyze.smoothing import delay_of, draw_smoothed

            figures["smoothed"] = smoothed.figures | delay_of(figures["latency"]["round_trip"])
            pictures.append(draw_smoothed(smoothed))
        write_text(partial / _SOURCE, source)
        write_json(partial / "figures.json", figures)
        title = f"Log of the bus: {', '.join(path.name for path in paths)}"
        write_text(partial / "report.html", report_html(title, figures, pictures))
    return Result(figures, folder)


@contextmanager
def _all_or_nothing(folder: Path) -> Iterator[Path]:
    """Give a folder to write to; its files come into ``folder`` if the block ends well."""
    there = next(place for place in folder.absolute().parents if place.exists())
    with TemporaryDirectory(prefix=f".{folder.name}.", dir=there) as partial:
        yield Path(partial)
        folder.mkdir(parents=True, exist_ok=True)
        for file in Path(partial).iterdir():
            file.replace(folder / file.name)


def _smoothed(folder: Path, file: Path) -> "SmoothedTable":
    shared = SharedTable(str(file), nominal_vehicle(file))
    vehicle = load_settings(VehicleModelSettings, shared=shared)
    # Only a smoother needs filterpy, which imports most of scipy.
    from steer_by_wire.tools.analyze.smoothing import SmoothedTable

    return SmoothedTable(folder / "smoothed.csv", vehicle)


if __name__ == "__main__":
    sys.exit(main())
