"""Identify a car from logs of driving: the files that --vehicle takes, with intervals.

    steer-by-wire identify drive.csv --known car.toml --out out/car
    steer-by-wire identify --predict out/car/vehicle.toml another_drive.csv

LOG is a CSV of time series, whose columns have names that end in units (hand_wheel_rad, speed_m_s,
yaw_rate_rad_s, ...) or are mapped by --columns; `identify new LOG` proposes such a mapping. Or it
is any log of the bus that analyze reads: then actuator.toml and network.toml are of commands and
echoes, too.
"""

import argparse
import signal
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from math import inf
from pathlib import Path

from rich.progress import Progress

from steer_by_wire.closed_loop.identification.bus_series import read_bus
from steer_by_wire.closed_loop.identification.columns import (
    is_table,
    joined,
    proposed_mapping,
    read_columns,
)
from steer_by_wire.closed_loop.identification.delay_margin import DelayMargin, delay_margin
from steer_by_wire.closed_loop.identification.figures import TOLD, Verdict
from steer_by_wire.closed_loop.identification.fit import Stopped
from steer_by_wire.closed_loop.identification.identified import (
    Identification,
    doubts_about,
    identify,
    predict,
)
from steer_by_wire.closed_loop.identification.network_file import network_files
from steer_by_wire.closed_loop.identification.parameters import Known
from steer_by_wire.closed_loop.identification.steering import Steering, steering_of
from steer_by_wire.closed_loop.identification.time_series import Channel, Drive, make_drive
from steer_by_wire.closed_loop.identification.vehicle_file import (
    actuator_toml,
    figure_line,
    read_vehicle,
    vehicle_toml,
)
from steer_by_wire.closed_loop.recordings.logged import LogError
from steer_by_wire.closed_loop.reports.terminal import counting_bars, plain_console
from steer_by_wire.controller.settings import PRESETS
from steer_by_wire.dbc.bus_language import add_dialect_argument, read_language
from steer_by_wire.runtime.command_line import (
    add_out_argument,
    command_parser,
    number,
    run_main,
    say,
    seconds,
)
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.output_file import write_text
from steer_by_wire.runtime.program.report import json_text
from steer_by_wire.runtime.settings import SettingsError, load_settings, read_preset

NAME = "steer-by-wire identify"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    example = f"{NAME} new drive.csv > columns.toml\n{NAME} drive.csv --columns columns.toml"
    parser = command_parser(NAME, __doc__, example, "[new] LOG... [options]")
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG", help="time series, or a log")
    parser.add_argument(
        "--from", dest="start_s", type=number(0.0, 1e9, "s"), metavar="S", help="leave out earlier"
    )
    parser.add_argument(
        "--to", dest="end_s", type=seconds, metavar="S", help="leave out what comes later"
    )
    parser.add_argument(
        "--columns", type=Path, metavar="MAP.toml", help="which columns are what, and their units"
    )
    parser.add_argument(
        "--known", type=Path, metavar="KNOWN.toml",
        help=f"what is known of the car: {', '.join(Known.model_fields)}",
    )  # fmt: skip
    parser.add_argument(
        "--predict", type=Path, metavar="VEHICLE.toml",
        help="do not identify: print how well a vehicle predicts LOG",
    )  # fmt: skip
    parser.add_argument(
        "--controller", metavar="PRESET",
        help="whose tolerated delays are told (default: highway_pd, below 8 m/s practical_pd)",
    )  # fmt: skip
    add_dialect_argument(parser, "read the messages of a car")
    add_out_argument(parser, "out/identified", "folder for the results")
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    if options.controller is not None:
        read_preset(PRESETS, options.controller)  # refused before the fit
    if options.logs[0] == Path("new"):
        if len(options.logs) == 1:
            raise SettingsError("new: name a LOG whose columns are to be mapped")
        print("".join(map(proposed_mapping, options.logs[1:])), end="")
        return ExitStatus.OK
    with counting_bars(plain_console(is_error=True)) as bars:
        progress = _Progress(bars)
        try:
            channels, network = _read(options, progress)
            source = ", ".join(log.name for log in options.logs)
            between = (options.start_s or -inf, options.end_s or inf)
            chosen = [one.within([between], 0.0) for one in channels]
            is_part = options.start_s is not None or options.end_s is not None
            if is_part and not any(len(one.time_s) for one in chosen):
                raise SettingsError(f"{source}: has no sample between --from and --to")
            drive, steering = make_drive(chosen, source), steering_of(chosen)
        except KeyboardInterrupt:
            say(NAME, "interrupted while the logs were read: no file is written", sys.stderr)
            return ExitStatus.INTERRUPTED
        if options.predict is None:
            lines = _identified(options, drive, source, steering, network, progress)
        else:
            percent, notes = predict(drive, *read_vehicle(options.predict))
            lines = [*map("note: {}".format, notes), f"residual of yaw rate: {percent:.2f} %"]
    plain_console().print("\n".join(lines))
    return ExitStatus.INTERRUPTED if progress.stopped_in else ExitStatus.OK


def _identified(
    options: argparse.Namespace,
    drive: Drive,
    source: str,
    steering: Steering | None,
    network: Mapping[str, str],
    progress: "_Progress",
) -> list[str]:
    """Identify a drive and write the files; returns what is printed.

    ``network``  texts of the network's files, by name
    """
    from steer_by_wire.tools.identify.report import report_html  # loads matplotlib

    known = Known() if options.known is None else load_settings(Known, file=options.known)
    progress.keep_the_best()
    found = identify(drive, known, progress.advance)
    doubts = doubts_about(found.fit, progress.advance)
    margin = delay_margin(found.fit, found.speed_m_s, options.controller, progress.advance)
    stopped = []
    if where := progress.stopped_in:
        is_of_car = where != "delays"
        doubt = "intervals may be wrong" if is_of_car else "tolerated delays were not computed"
        stopped.append(f"interrupted in {where}: the best so far; {doubt}")
        source += f" ({stopped[0]})"
    files = {
        "vehicle.toml": vehicle_toml(found.fit, found.figures, found.speed_m_s, source),
        "actuator.toml": actuator_toml(steering, found.figures, source),
    }
    figures, notes = (steering.figures, steering.notes) if steering else ([], [])
    found = found._replace(
        figures=[*found.figures, *figures], notes=[*found.notes, *notes, *stopped]
    )
    advice = _advice(margin, found)
    record = {
        "figures": {
            one.name: {
                "value": one.value, "interval": [one.low, one.high], "unit": one.unit,
                "verdict": str(one.verdict), "note": one.note,
            }
            for one in found.figures
        },
        "residual_percent": found.fit.residual_percent,
        "tests": [one._asdict() for one in doubts],
        "notes": found.notes,
        "delays": advice,
    }  # fmt: skip
    files |= {**network, "report.json": json_text(record)}
    files["report.html"] = report_html(source, found, doubts, advice)
    options.out.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        write_text(options.out / name, text)
    return [
        *map("note: {}".format, found.notes),
        *map(figure_line, found.figures),
        *map("{0.what}: {0.result}".format, doubts),
        f"residual of yaw rate: {found.fit.residual_percent:.2f} %",
        *advice,
        f"files in {options.out}: {', '.join(files)}",
    ]


def _read(
    options: argparse.Namespace, progress: "_Progress"
) -> tuple[list[Channel], Mapping[str, str]]:
    """Return the channels of all logs, and files of the network that a log of the bus tells."""
    if options.columns is not None or all(map(is_table, options.logs)):
        if options.dialect is not None:
            raise SettingsError(
                "--dialect is of a log of the bus, and these are tables: leave it out"
            )
        return joined([read_columns(log, options.columns) for log in options.logs]), {}
    if tables := [log for log in options.logs if is_table(log)]:
        other = next(log for log in options.logs if log not in tables)
        raise SettingsError(
            f"{other}: is not a table of time series, but {tables[0].name} is: give tables alone,"
            " or logs of the bus alone"
        )
    try:

        def advance(file: str, share: float | None) -> None:
            progress.advance(f"reading {file}", 1 + round(99 * (share or 0.0)), 100)

        bus = read_bus(options.logs, read_language(options.dialect), advance)
    except LogError as error:
        raise SettingsError(str(error)) from error
    return bus.channels, network_files(bus.figures, bus.latencies)


def _advice(margin: DelayMargin | None, found: Identification) -> list[str]:
    """Return what is said of delays, and what to measure next."""
    if margin is None:
        return []
    by_name = {one.name: one for one in found.figures}
    own = by_name.get("actuator:delay_and_lag_s", by_name["delay_and_lag_s"])
    lines = [
        f"{margin.controller} at {3.6 * found.speed_m_s:.0f} km/h survives constant delays up to"
        f" {1e3 * margin.margin_s:.0f} ms [{1e3 * margin.low_s:.0f}, {1e3 * margin.high_s:.0f}]"
    ]
    if own.high >= 0.0:
        lines[0] += (
            f", of which the steering's own delay and lag take about {1e3 * own.value:.0f} ms"
            f" [{1e3 * own.low:.0f}, {1e3 * own.high:.0f}]"
        )
    if margin.share > 0.5:
        _, how = TOLD.get(margin.narrows, ("", "drive more of it"))
        lines.append(f"most of that interval comes from {margin.narrows}: {how}")
    lacking = {partner for one in found.figures for partner in one.partners}
    lacking |= {margin.narrows} if margin.share > 0.5 else set()
    if tell := ", ".join(keys for name, (keys, _) in TOLD.items() if name in lacking):
        lines.append(f"next: tell by --known, as far as it is known: {tell}")
    wanted = {one.note for one in found.figures if one.verdict is Verdict.NOT_IDENTIFIABLE}
    # A drive that another one begins with is not told twice.
    whole = (one for one in sorted(wanted) if not any(it.startswith(f"{one},") for it in wanted))
    return lines + [f"next: {note}" for note in whole if note.startswith("drive")]


class _Progress:
    """Shows how far it is and how long the rest takes; Ctrl-C stops what is timed."""

    def __init__(self, bars: Progress) -> None:
        self._bars, self._task = bars, bars.add_task("reading", total=None)
        self.stopped_in, self._what, self._hint, self._is_stopping = "", "", "", False

    def keep_the_best(self) -> None:
        """Take Ctrl-C for the end of what goes on, and not of the program."""
        self._hint = " (Ctrl-C keeps the best)"
        signal.signal(signal.SIGINT, self._stop)

    def _stop(self, _number: int, _frame: object) -> None:
        self._is_stopping = True
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a second one ends it at once

    def advance(self, what: str, done: int, of: int) -> None:
        """Show how far it is; raises Stopped."""
        if self._is_stopping:
            self.stopped_in = self.stopped_in or what
            raise Stopped
        if what != self._what:
            self._what = what
            self._bars.reset(self._task, description=what + self._hint)
        self._bars.update(self._task, completed=done, total=of)


if __name__ == "__main__":
    sys.exit(main())
