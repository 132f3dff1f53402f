"""Find which round trip of the bus makes a hand wheel with force feedback shake.

    steer-by-wire feedback --preset large_sedan --speeds-km-h 30,80,130 --plot feedback.png

For each torque gradient, grip and speed it prints the first unstable round trip of the bus, both
ways together: exact for whole cycles, for small angles and the tyres' grip at rest. The first line
is a vehicle whose tyres follow at once. The line below it is the same car with tyres that lag, as
tyres do: their force builds up over a relaxation length. "again" marks a loop that is stable again
at a longer round trip; --json has every range. The last column is the
round trip up to which the wheel is passive after Colgate, from damping and torque gradient alone.
With --jitter-at a table for each round trip shows by how much more it may vary, in any pattern.

--frontier compares the feedback laws, each at its best for a round trip, at equal torque noise and
with the middle one of the torque gradients and of the speeds: how much of the felt torque is
changed (RMS of 0.3 to 3 Hz) and how late a change of the road is felt. All hold the gradient ±40 %
and jitter of 30 %; runs add friction, a patch of ice, jitter from frame to frame.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import product
from math import inf
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

from rich.table import Table

from steer_by_wire.closed_loop.reports.terminal import plain_console, plain_table
from steer_by_wire.closed_loop.scripting.feedback import (
    UP_TO_S,
    UnstableRange,
    tolerated_jitter_s,
    unstable_round_trips,
)
from steer_by_wire.hand_wheel.analysis.nominal_road import Rack, road_vehicle
from steer_by_wire.hand_wheel.analysis.sampled_laws import PASS_THROUGH, sampled_cdob
from steer_by_wire.hand_wheel.wheel import GRIPS, WheelSettings
from steer_by_wire.plant_emulator.settings import PRESETS, PlantSettings
from steer_by_wire.runtime.command_line import (
    add_json_argument,
    command_parser,
    number,
    output_file,
    output_folder,
    run_main,
)
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.output_file import write_file
from steer_by_wire.runtime.program.report import show_or_write
from steer_by_wire.runtime.settings import SettingsError, load_settings, read_preset
from steer_by_wire.tools.feedback.frontier import ROUND_TRIPS_S, Bench, Design, Point
from steer_by_wire.tools.feedback.frontier_runs import frontier

R = TypeVar("R")
NAME = "steer-by-wire feedback"


class Row(NamedTuple):
    """One loop and its ranges of unstable round trips."""

    torque_gradient_n_m: float
    grip: str
    speed_km_h: float
    unstable: tuple[UnstableRange, ...]
    passive_s: float
    jitter_s: tuple[float, ...]
    """At each round trip of ``--jitter-at``."""

    @property
    def first_s(self) -> float:
        """The first unstable round trip [s]."""
        return self.unstable[0].start_s if self.unstable else inf


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = command_parser(
        NAME, __doc__, f"{NAME} --torque-gradients 6 --speeds-km-h 80 --cdob 50"
    )
    parser.add_argument(
        "--preset", default="large_sedan", metavar="NAME",
        help="the plant preset whose [vehicle] is taken (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--torque-gradients", type=_numbers(0.01, 1000.0, "N m/rad"), default=[3.0, 6.0, 12.0],
        metavar="N_M,...", help="torque per angle of the hand wheel (default: 3,6,12)",
    )  # fmt: skip
    parser.add_argument(
        "--speeds-km-h", type=_numbers(1.0, 250.0, "km/h"), default=[30.0, 80.0, 130.0],
        metavar="KM_H,...", help="default: 30,80,130",
    )  # fmt: skip
    parser.add_argument(
        "--jitter-at", type=_numbers(0.0, 2000.0, "ms"), default=[], metavar="MS,...",
        help="show how much longer than these a round trip may be, from frame to frame",
    )  # fmt: skip
    wheel, rack, defaults = WheelSettings(), Rack(), dict[str, float | None]()
    for option, default, low, high, unit, what in (
        ("--cycle-ms", 1.0, 1e-3, 100.0, "ms", "cycle of the feedback"),
        ("--damping", wheel.damping_n_m_s, 1e-3, 100.0, "N m s/rad", "damping of the hand wheel"),
        ("--inertia", wheel.inertia_kg_m2, 1e-3, 10.0, "kg m2", "inertia of the hand wheel"),
        ("--torque-sensor", wheel.sensor_n_m_rad, 0.0, 1e3, "N m/rad", "stiffness; 0: rigid"),
        ("--rack-hz", rack.bandwidth_hz, 1e-3, 100.0, "Hz", "bandwidth of the rack's servo"),
        ("--lag-ms", None, 1e-3, 1e3, "ms", "lag of first order in place of that servo"),
        ("--cdob", None, 0.1, 1e3, "rad/s", "bandwidth of a communication disturbance observer"),
        ("--washout", 2.0, 0.0, 100.0, "rad/s", "slower torque is the road's alone"),
        ("--torque-noise", 0.05, 1e-3, 10.0, "N m", "noise that --frontier lets a law make"),
    ):
        added = parser.add_argument(
            option, type=number(low, high, unit), metavar="VALUE",
            help=f"{what} [{unit}]" + ("" if default is None else f" (default: {default:g})"),
        )  # fmt: skip
        defaults[added.dest] = default
    parser.add_argument(
        "--plot", type=_png_file, metavar="FILE.png",
        help="draw the first unstable round trip over the torque gradient",
    )  # fmt: skip
    parser.add_argument(
        "--frontier", type=output_folder, metavar="DIR",
        help="compare the feedback laws instead; writes frontier.png and frontier.json there",
    )  # fmt: skip
    add_json_argument(parser)
    return run_main(NAME, partial(_run, parser.parse_args(arguments), defaults))


def _run(options: argparse.Namespace, defaults: Mapping[str, float | None]) -> int:
    _refuse_idle(options)
    for name, value in defaults.items():
        if getattr(options, name) is None:
            setattr(options, name, value)
    plant = load_settings(PlantSettings, read_preset(PRESETS, options.preset))
    gradient_n_m, km_h = _middle(options.torque_gradients), _middle(options.speeds_km_h)
    lag_s = None if options.lag_ms is None else options.lag_ms / 1e3
    bench = Bench(
        road_vehicle(plant.vehicle)._replace(speed_m_s=km_h / 3.6),
        gradient_n_m,
        Rack(options.rack_hz, lag_s=lag_s),
        WheelSettings(
            inertia_kg_m2=options.inertia,
            damping_n_m_s=options.damping,
            sensor_n_m_rad=options.torque_sensor,
        ),
        options.cycle_ms / 1e3,
        options.torque_noise,
    )
    lagging = road_vehicle(plant.vehicle, plant.car)._replace(speed_m_s=km_h / 3.6)
    models = [bench] if plant.car is None else [bench, bench._replace(vehicle=lagging)]
    if options.frontier is not None:
        title = f"{options.preset}, {gradient_n_m:g} N m/rad, {km_h:g} km/h"
        return _show_frontier(options.frontier, models, title)
    rows = [_rows(options, each, options.torque_gradients) for each in models]
    title = f"first unstable round trip [ms], {options.preset}, cycle {options.cycle_ms:g} ms"
    passive = {"passive": lambda row: f"{1e3 * row.passive_s:.0f}"}
    shown = [(title, _first, passive)]
    for place, at_ms in enumerate(options.jitter_at):
        title = f"tolerated jitter [ms] above a round trip of {at_ms:g} ms"
        shown.append((title, partial(_jitter, place), {}))
    headings = "gradient [N m/rad]", "grip"
    speeds = [f"{speed:g} km/h" for speed in options.speeds_km_h]
    tables = [
        _table(title, headings, speeds, rows, _words, cell, last) for title, cell, last in shown
    ]
    loops = [
        [row._asdict() | {"unstable": [each._asdict() for each in row.unstable]} for row in each]
        for each in rows
    ]
    show = partial(plain_console().print, *tables, sep="\n")
    show_or_write(options.json, {"preset": options.preset, **_of_both("loops", loops)}, show)
    if options.plot is not None:
        from steer_by_wire.tools.feedback.picture import draw  # loads matplotlib

        gradients = [1.0 * 1.2**step for step in range(18)]
        drawn = [
            [(r.speed_km_h, r.grip, r.torque_gradient_n_m, r.first_s) for r in each]
            for each in (_rows(options, model, gradients) for model in models)
        ]
        write_file(options.plot, draw(drawn, bench.cycle_s, options.preset))
    return ExitStatus.OK


def _refuse_idle(options: argparse.Namespace) -> None:
    """Raise SettingsError for an option that would do nothing next to the others."""
    if options.cdob is None and options.washout is not None:
        raise SettingsError("--washout does nothing without --cdob")
    if options.lag_ms is not None and options.rack_hz is not None:
        raise SettingsError("--rack-hz does nothing with --lag-ms")
    if options.frontier is None and options.torque_noise is not None:
        raise SettingsError("--torque-noise does nothing without --frontier")
    for idle in ("cdob", "jitter_at", "plot", "json"):
        if getattr(options, idle) and options.frontier is not None:
            raise SettingsError(f"--{idle.replace('_', '-')} does nothing with --frontier")


def _middle(values: Sequence[float]) -> float:
    return sorted(values)[len(values) // 2]


def _png_file(text: str) -> Path:
    if Path(text).suffix.lower() != ".png":
        raise argparse.ArgumentTypeError(f"{text!r} is no PNG: give a name that ends in .png")
    return output_file(text)


def _of_both(name: str, models: Sequence[Sequence[Any]]) -> dict[str, Any]:
    """Return what is known of each model by its name in the JSON."""
    return dict(zip((name, f"{name}_with_tyre_lag"), models, strict=False))


def _rows(options: argparse.Namespace, model: Bench, gradients_n_m: Sequence[float]) -> list[Row]:
    """Return the loop of each torque gradient, grip and speed."""
    rows = []
    for gradient_n_m, grip, km_h in product(gradients_n_m, GRIPS, options.speeds_km_h):
        moving = model.vehicle._replace(speed_m_s=km_h / 3.6)
        case = model._replace(vehicle=moving, gradient_n_m=gradient_n_m, grip=grip)
        law = PASS_THROUGH
        if options.cdob is not None:
            law = sampled_cdob(case.road(), model.cycle_s, options.cdob, options.washout)
        loop = case.loop(Design("", law), 1.0)
        held_n_m_s = model.wheel.damping_n_m_s + GRIPS[grip].damping_n_m_s
        passive_s = max(0.0, held_n_m_s / gradient_n_m - 0.5 * model.cycle_s)
        jitter_s = tuple(tolerated_jitter_s(loop, at_ms / 1e3) for at_ms in options.jitter_at)
        unstable = unstable_round_trips(loop, UP_TO_S)
        rows.append(Row(gradient_n_m, grip, km_h, unstable, passive_s, jitter_s))
    return rows


def _show_frontier(folder: Path, models: Sequence[Bench], title: str) -> int:
    from steer_by_wire.tools.feedback.picture import draw_frontier  # loads matplotlib

    folder.mkdir(parents=True, exist_ok=True)  # before a minute's work
    found = [frontier(bench) for bench in models]
    marks = "F, I, J: shakes with friction, ice, jitter"
    trips = [f"{1e3 * at_s:g} ms" for at_s in ROUND_TRIPS_S]
    tables = [
        _table(what, ("law",), trips, found, lambda point: (point.law,), cell)
        for what, cell in (
            (f"felt torque changed by [%], {title}; {marks}", _changed),
            ("a change of the road felt after [ms]", _late),
        )
    ]
    points = [
        [point._asdict() | {"design": point.design and point.design.settings} for point in each]
        for each in found
    ]
    write_file(folder / "frontier.png", draw_frontier(found, title))
    show = partial(plain_console().print, *tables, sep="\n")
    written = {"title": title, **_of_both("points", points)}
    show_or_write(folder / "frontier.json", written, show)
    return ExitStatus.OK


def _changed(point: Point) -> str:
    """Return the error, and the runs in which the wheel shakes."""
    marks = "".join(condition[0].upper() for condition in point.fails)
    return "none" if point.design is None else f"{1e2 * point.changed:.0f}{marks and f' {marks}'}"


def _late(point: Point) -> str:
    return "never" if point.late_s == inf else f"{1e3 * point.late_s:.0f}"


def _first(row: Row) -> str:
    again = ", again" if row.unstable and row.unstable[0].end_s is not None else ""
    return f"{1e3 * row.first_s:.1f}{again}" if row.unstable else "never"


def _words(row: Row) -> tuple[str, str]:
    return f"{row.torque_gradient_n_m:g}", row.grip.replace("_", " ")


def _jitter(place: int, row: Row) -> str:
    return f"{1e3 * row.jitter_s[place]:.1f}"


def _table(
    title: str,
    headings: Sequence[str],
    columns: Sequence[str],
    models: Sequence[Sequence[R]],
    words: Callable[[R], Sequence[str]],
    cell: Callable[[R], str],
    last: Mapping[str, Callable[[R], str]] = MappingProxyType({}),
) -> Table:
    """Return a table with a line for as many results as it has ``columns``, ``words`` before them.

    ``models``  results with tyres that follow at once and, a line below, with tyres that lag
    ``last``    a column more, by its heading, without a value for tyres that lag
    """
    table, lagging = plain_table(headings, [*columns, *last], title), ["", "  tyres lag"]
    for first in range(0, len(models[0]), len(columns)):
        for place, results in enumerate(models):
            line = results[first : first + len(columns)]
            before = lagging[-len(headings) :] if place else words(line[0])
            after = [more(line[0]) for more in last.values()] if not place else ()
            table.add_row(*before, *map(cell, line), *after)
    return table


def _numbers(low: float, high: float, unit: str) -> Any:
    read = number(low, high, unit)
    return lambda text: [read(part) for part in text.split(",")]


if __name__ == "__main__":
    sys.exit(main())
