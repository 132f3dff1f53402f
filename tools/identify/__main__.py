"""Identify a car from logs of driving: the files that --vehicle takes, with intervals.

    steer-by-wire identify drive.csv --known car.toml --out out/car
    steer-by-wire identify --predict out/car/vehicle.toml another_drive.csv

LOG is a CSV of time series, whose columns have names that end in units (hand_wheel_rad, speed_m_s,
yaw_rate_rad_s, ...) or are mapped by --columns; `identify new LOG` proposes such a mapping.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from steer_by_wire.closed_loop.identification.columns import (
    joined,
    proposed_mapping,
    read_columns,
)
from steer_by_wire.closed_loop.identification.figures import Figure
from steer_by_wire.closed_loop.identification.fit import EVALUATIONS_MAX, Progress
from steer_by_wire.closed_loop.identification.identified import Identification, identify, predict
from steer_by_wire.closed_loop.identification.parameters import Known
from steer_by_wire.closed_loop.identification.time_series import Channel, Drive, make_drive
from steer_by_wire.closed_loop.identification.vehicle_file import (
    figure_line,
    read_vehicle,
    vehicle_toml,
)
from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.runtime.command_line import (
    add_out_argument,
    command_parser,
    number,
    run_main,
    seconds,
)
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.output_file import write_text
from steer_by_wire.runtime.program.report import write_json
from steer_by_wire.runtime.settings import load_settings

NAME = "steer-by-wire identify"
_NEW = "new"


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
    add_out_argument(parser, "out/identified", "folder for the results")
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    show = plain_console().print
    if options.logs[0] == Path(_NEW):
        for log in options.logs[1:]:
            print(proposed_mapping(log), end="")
        return ExitStatus.OK
    drive = _drive(options)
    if options.predict is not None:
        prediction = predict(drive, read_vehicle(options.predict))
        for note in prediction.notes:
            show(f"note: {note}")
        show(f"residual of yaw rate: {prediction.residual_percent:.2f} %")
        return ExitStatus.OK
    known = Known() if options.known is None else load_settings(Known, file=options.known)
    known.check(str(options.known))
    found = identify(drive, known, _progress())
    _write(options, found)
    for line in _lines(found):
        show(line)
    show(f"files: {options.out}")
    return ExitStatus.OK


def _drive(options: argparse.Namespace) -> Drive:
    channels = joined([read_columns(log, options.columns) for log in options.logs])
    return make_drive(
        (_between(one, options.start_s, options.end_s) for one in channels),
        ", ".join(log.name for log in options.logs),
    )


def _between(channel: Channel, start_s: float | None, end_s: float | None) -> Channel:
    """Return what lies between two times since the channel's start."""
    since_s = channel.time_s - (channel.time_s[0] if len(channel.time_s) else 0.0)
    inside = (since_s >= (start_s or 0.0)) & (since_s <= (end_s or float("inf")))
    return channel._replace(time_s=channel.time_s[inside], values=channel.values[inside])


def _progress() -> Progress:
    """Return what shows a line on a terminal: how far, and the time left at most."""
    begun_s = time.monotonic()

    def advance(evaluation: int, cost: float) -> None:
        if not sys.stderr.isatty():
            return
        each_s = (time.monotonic() - begun_s) / evaluation
        left_s = each_s * max(EVALUATIONS_MAX - evaluation, 0)
        text = f"fit: evaluation {evaluation}, cost {cost:.4g}, at most {left_s:.0f} s left"
        print(f"\r{text}; Ctrl-C keeps the best  ", end="", file=sys.stderr, flush=True)

    return advance


def _lines(found: Identification) -> list[str]:
    lines = [f"note: {note}" for note in found.notes]
    lines += [figure_line(figure) for figure in found.figures]
    lines += [f"{doubt.what}: {doubt.result}" for doubt in found.doubts]
    lines.append(f"residual of yaw rate: {found.residual_percent:.2f} %")
    return lines


def _write(options: argparse.Namespace, found: Identification) -> None:
    options.out.mkdir(parents=True, exist_ok=True)
    source = ", ".join(log.name for log in options.logs)
    text = vehicle_toml(found.found, found.figures, found.speed_m_s, source)
    write_text(options.out / "vehicle.toml", text)
    write_json(options.out / "report.json", _record(found))


def _record(found: Identification) -> dict[str, object]:
    def of(figure: Figure) -> dict[str, object]:
        ends = [None if abs(end) == float("inf") else end for end in (figure.low, figure.high)]
        return {
            "value": figure.value,
            "interval": ends,
            "unit": figure.unit,
            "verdict": str(figure.verdict),
            "note": figure.note,
        }

    return {
        "figures": {figure.name: of(figure) for figure in found.figures},
        "residual_percent": found.residual_percent,
        "tests": [doubt._asdict() for doubt in found.doubts],
        "notes": list(found.notes),
    }


if __name__ == "__main__":
    sys.exit(main())
