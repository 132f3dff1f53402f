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
import time
from collections.abc import Mapping, Sequence
from functools import partial
from math import inf, isfinite
from pathlib import Path

from steer_by_wire.closed_loop.identification.bus_series import BusLog, read_bus
from steer_by_wire.closed_loop.identification.columns import (
    is_table,
    joined,
    proposed_mapping,
    read_columns,
)
from steer_by_wire.closed_loop.identification.delay_margin import DelayMargin, delay_margin
from steer_by_wire.closed_loop.identification.figures import Verdict
from steer_by_wire.closed_loop.identification.fit import Stopped
from steer_by_wire.closed_loop.identification.identified import Identification, identify, predict
from steer_by_wire.closed_loop.identification.network_file import network_toml, trace_csv
from steer_by_wire.closed_loop.identification.parameters import Known
from steer_by_wire.closed_loop.identification.steering import Steering, steering_of
from steer_by_wire.closed_loop.identification.time_series import Channel, make_drive
from steer_by_wire.closed_loop.identification.vehicle_file import (
    figure_line,
    read_vehicle,
    table_lines,
    vehicle_toml,
)
from steer_by_wire.closed_loop.recordings.logged import LogError
from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.controller.settings import PRESETS
from steer_by_wire.dbc.bus_language import add_dialect_argument, read_language
from steer_by_wire.plant_emulator.vehicle.settings import LAG_S_MIN
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
from steer_by_wire.runtime.program.output_folder import refuse_another_run
from steer_by_wire.runtime.program.report import write_json
from steer_by_wire.runtime.settings import SettingsError, load_settings, read_preset

NAME = "steer-by-wire identify"
_MEASURED = {
    "front_axle_distance_m": "weigh the axles, and tell it by --known",
    "wheelbase_m": "measure it, and tell it by --known",
}


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
    show = plain_console().print
    if options.controller is not None:
        read_preset(PRESETS, options.controller)  # refused before the fit
    if options.logs[0] == Path("new"):
        if len(options.logs) == 1:
            raise SettingsError("new: name a LOG whose columns are to be mapped")
        print("".join(map(proposed_mapping, options.logs[1:])), end="")
        return ExitStatus.OK
    refuse_another_run(options.out, {})
    progress, source = _Progress(), ", ".join(log.name for log in options.logs)
    try:
        channels, bus = _read(options, progress)
        between = (options.start_s or -inf, options.end_s or inf)
        chosen = [one.within([between], 0.0) for one in channels]
        if not any(len(one.time_s) for one in chosen):
            raise SettingsError(f"{source}: has no sample between --from and --to")
        drive, steering = make_drive(chosen, source), steering_of(chosen)
    except KeyboardInterrupt:
        say(NAME, "interrupted while the logs were read: no file is written", sys.stderr)
        return ExitStatus.INTERRUPTED
    if options.predict is not None:
        percent, notes = predict(drive, read_vehicle(options.predict))
        show(
            "".join(f"note: {note}\n" for note in notes) + f"residual of yaw rate: {percent:.2f} %"
        )
        return ExitStatus.OK
    known = Known() if options.known is None else load_settings(Known, file=options.known)
    progress.keep_the_best()
    found = identify(drive, known, progress.advance)
    margin = delay_margin(found.found, found.speed_m_s, options.controller, progress.advance)
    notes = [*found.notes, *(steering.notes if steering else ())]
    if progress.stopped_in:
        doubt = "intervals may be wrong"
        if progress.stopped_in == "delays":
            doubt = "tolerated delays were not computed"
        stopped = f"interrupted in {progress.stopped_in}: the best so far; {doubt}"
        notes, source = [*notes, stopped], f"{source} ({stopped})"
    texts = _tables(found, source, bus, steering)
    figures = [*found.figures, *(steering.figures if steering else ())]
    found = found._replace(figures=figures, notes=notes)
    advice = _advice(margin, found)
    _write(options.out, texts, found, advice)
    lines = [f"note: {note}" for note in found.notes]
    lines += [figure_line(figure) for figure in found.figures]
    lines += [f"{doubt.what}: {doubt.result}" for doubt in found.doubts]
    lines += [f"residual of yaw rate: {found.residual_percent:.2f} %", *advice]
    names = ", ".join([*texts, "report.json", "report.html"])
    show("\n".join([*lines, f"files in {options.out}: {names}"]))
    return ExitStatus.INTERRUPTED if progress.stopped_in else ExitStatus.OK


def _read(
    options: argparse.Namespace, progress: "_Progress"
) -> tuple[list[Channel], BusLog | None]:
    """Return the channels of all logs, and what a log of the bus has besides."""
    if options.columns is not None or all(map(is_table, options.logs)):
        if options.dialect is not None:
            raise SettingsError(
                "--dialect is of a log of the bus, and these are tables: leave it out"
            )
        return joined([read_columns(log, options.columns) for log in options.logs]), None
    try:

        def advance(file: str, share: float | None) -> None:
            progress.advance(f"reading {file}", 1 + round(99 * (share or 0.0)), 100)

        bus = read_bus(options.logs, read_language(options.dialect), advance)
    except LogError as error:
        raise SettingsError(str(error)) from error
    return bus.channels, bus


def _advice(margin: DelayMargin | None, found: Identification) -> list[str]:
    """Return what is said of delays, and what to measure next."""
    if margin is None:
        return []
    by_name = {one.name: one for one in found.figures}
    own = by_name.get("actuator:delay_and_lag_s", by_name["delay_and_lag_s"])
    lines = [
        f"{margin.controller} at {3.6 * found.speed_m_s:.0f} km/h survives constant delays up to"
        f" {1e3 * margin.margin_s:.0f} ms [{1e3 * margin.low_s:.0f}, {1e3 * margin.high_s:.0f}], of"
        f" which the steering's own delay and lag take about {1e3 * own.value:.0f} ms"
        f" [{1e3 * own.low:.0f}, {1e3 * own.high:.0f}]"
    ]
    if margin.share > 0.5:
        how = _MEASURED.get(margin.narrows, "drive more of it")
        lines.append(f"most of that interval comes from {margin.narrows}: {how}")
    wanted = {one.note for one in found.figures if one.verdict is Verdict.NOT_IDENTIFIABLE}
    # A drive that another one begins with is not told twice.
    whole = (one for one in sorted(wanted) if not any(it.startswith(f"{one},") for it in wanted))
    return lines + [f"next: {note}" for note in whole if note.startswith("drive")]


class _Progress:
    """Shows a line on a terminal, how far and the time left at most; Ctrl-C stops what is timed."""

    def __init__(self) -> None:
        self.stopped_in, self._what, self._begun_s, self._is_stopping = "", "", 0.0, False

    def keep_the_best(self) -> None:
        """Take Ctrl-C for the end of what goes on, and not of the program."""
        signal.signal(signal.SIGINT, self._stop)

    def _stop(self, _number: int, _frame: object) -> None:
        self._is_stopping = True
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a second one ends it at once

    def advance(self, what: str, done: int, of: int) -> None:
        """Show how far it is; raises Stopped."""
        if self._is_stopping:
            self.stopped_in = self.stopped_in or what
            raise Stopped
        if not sys.stderr.isatty():
            return
        if what != self._what:
            self._what, self._begun_s = what, time.monotonic()
        left_s = (time.monotonic() - self._begun_s) / done * (of - done)
        left = f"{what}: {done} of at most {of}, at most {left_s:.0f} s left"
        print(f"\r{left:70}; Ctrl-C keeps the best", end="", file=sys.stderr, flush=True)


def _tables(
    found: Identification, source: str, bus: BusLog | None, steering: Steering | None
) -> dict[str, str]:
    """Return the text of the files that other commands take, by name."""
    lines = [f"# Steering identified from {source}."]
    if steering is None:
        total = {one.name: one for one in found.figures}["delay_and_lag_s"]
        lines += [
            "# The sum of delay and lag, as a lag; sensors included.",
            f"# {figure_line(total)}",
        ]
        table = {"lag_s": total.value if total.value >= LAG_S_MIN else 0.0}
    else:
        lines += [f"# {figure_line(one)}" for one in steering.figures]
        table = steering.table
    files = {
        "vehicle.toml": vehicle_toml(found.found, found.figures, found.speed_m_s, source),
        "actuator.toml": "\n".join([*lines, *table_lines("actuator", table), ""]),
    }
    network = None if bus is None else network_toml(bus.figures, bus.latencies)
    if bus is not None and network is not None:
        files["network.toml"] = network
        traces = {way: bus.latencies.history[way] for way in ("downlink", "uplink")}
        files |= {f"{way}.csv": trace_csv(one) for way, one in traces.items() if one.is_whole}
    return files


def _write(
    out: Path, texts: Mapping[str, str], found: Identification, advice: Sequence[str]
) -> None:  # fmt: skip
    from steer_by_wire.tools.identify.report import report_html  # loads matplotlib

    record = {
        "figures": {
            one.name: {
                "value": one.value,
                "interval": [end if isfinite(end) else None for end in (one.low, one.high)],
                "unit": one.unit,
                "verdict": str(one.verdict),
                "note": one.note,
            }
            for one in found.figures
        },
        "residual_percent": found.residual_percent,
        "tests": [doubt._asdict() for doubt in found.doubts],
        "notes": list(found.notes),
        "delays": list(advice),
    }
    out.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        write_text(out / name, text)
    write_json(out / "report.json", record)
    write_text(out / "report.html", report_html(found, advice))


if __name__ == "__main__":
    sys.exit(main())
