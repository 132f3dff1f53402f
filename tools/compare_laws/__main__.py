"""Compare all laws over delay, jitter, loss and actuator lag, and show where each breaks.

    steer-by-wire compare [--out DIR] [--step-ms 25] [--seeds 3]
    steer-by-wire compare --at-speed     # networks with memory at 5, 30 and 60 km/h: docs/packet.md
    steer-by-wire compare --interior 256 # the predictors between the corners of the box

Leaves in DIR comparison.csv, a line for each law, network and delay; comparison.png of the point
that each law follows, comparison_centre_of_gravity.png and error_over_delay.png; and comparison.md,
the tables of docs/predictor.md. Prints the worst RMS over the uncertainty box at a few delays, and
the first delay at which a law does not hold the path. Ctrl-C leaves the lines that are complete.
"""

import argparse
import csv
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

from steer_by_wire.closed_loop.parameter_space.uncertainty import paper_box
from steer_by_wire.closed_loop.reports.terminal import counting_bars, plain_console
from steer_by_wire.runtime.command_line import (
    add_out_argument,
    add_overrides_argument,
    command_parser,
    whole_number,
)
from steer_by_wire.runtime.program.program import ExitStatus, StopRequest, run_main
from steer_by_wire.tools.compare_laws.at_speed import DELAYS_S, compare_at_speed, markdown_at_speed
from steer_by_wire.tools.compare_laws.at_speed import Cell as CellAtSpeed
from steer_by_wire.tools.compare_laws.presentation import (
    draw_break_points,
    draw_comparison,
    markdown_lines,
    table_lines,
)
from steer_by_wire.tools.compare_laws.runs import (
    CONTESTANTS,
    NETWORKS,
    SETTLED_S,
    Cell,
    Contestant,
    compare,
    controller_settings,
    figures_m,
    own_contestant,
    plant_settings,
)

NAME = "steer-by-wire compare"
DELAY_MS_MAX = 600
INTERIOR_MAX = 10_000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = command_parser(NAME, __doc__, f"{NAME} --step-ms 100 --seeds 1 --duration-s 20")
    add_out_argument(parser, "out/comparison")
    parser.add_argument(
        "--step-ms", type=int, default=25, choices=(10, 20, 25, 50, 100),
        help="step between delays (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--seeds", type=int, default=3, choices=range(1, 101), metavar="1..100",
        help="seeds per random network (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--duration-s", type=float, default=60.0, choices=(20.0, 60.0, 120.0), metavar="S",
        help="duration of each run: 20, 60 or 120 (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--interior", type=whole_number(0, INTERIOR_MAX), default=0, metavar="POINTS",
        help="instead the predictors' centre of gravity at so many points inside the box",
    )  # fmt: skip
    parser.add_argument(
        "--law", action="append", default=[], metavar="PACKAGE.MODULE:LAW",
        help="a law of your own, with the tables of practical_pd_ddob; repeatable",
    )  # fmt: skip
    add_overrides_argument(
        parser, "--law-set", "a setting of your laws, such as own_law.gain=2", dest=None
    )
    parser.add_argument(
        "--at-speed",
        action="store_true",
        help="instead a lane change at 5, 30 and 60 km/h on networks with memory",
    )
    options = parser.parse_args(arguments)
    run = _run_interior if options.interior else _run_at_speed if options.at_speed else _run
    return run_main(NAME, partial(run, options))


AnyCell = TypeVar("AnyCell", Cell, CellAtSpeed)


def _cells(
    options: argparse.Namespace, name: str, compute: Callable[..., list[AnyCell]]
) -> tuple[list[AnyCell], bool]:
    """Compute cells with a bar and write them as CSV; returns whether they are complete too."""
    options.out.mkdir(parents=True, exist_ok=True)
    stop = StopRequest()
    with stop.on_signals(), counting_bars(plain_console()) as bars:
        task = bars.add_task("")
        cells = compute(
            progress=lambda done, of: bars.update(task, completed=done, total=of), should_stop=stop
        )
    file = options.out / name
    with file.open("w", newline="", encoding="utf-8") as opened:
        writer = csv.writer(opened)
        writer.writerow(cells[0]._fields)
        writer.writerows(cells)
    if stop.reason:
        print(f"interrupted: {len(cells)} results are in {file}")
    return cells, not stop.reason


def _run_at_speed(options: argparse.Namespace) -> int:
    compute = partial(compare_at_speed, DELAYS_S, options.seeds)
    cells, is_complete = _cells(options, "at_speed.csv", compute)
    if not is_complete:
        return ExitStatus.INTERRUPTED
    text = "\n".join(markdown_at_speed(cells))
    (options.out / "at_speed.md").write_text(text, encoding="utf-8")
    print(text)
    return ExitStatus.OK


def _run_interior(options: argparse.Namespace) -> int:
    for one in PREDICTORS:
        print(interior_line(one, interior_points(options.interior, options.duration_s, one)))
    return ExitStatus.OK


def _run(options: argparse.Namespace) -> int:
    begin_s = time.perf_counter()
    further = [own_contestant(law, options.law_set) for law in options.law]
    for one in further:  # before anything is run
        controller_settings(one, has_lag=False)
    delays_s = [1e-3 * ms for ms in range(0, DELAY_MS_MAX + 1, options.step_ms)]
    compute = partial(compare, delays_s, options.seeds, options.duration_s, further=further)
    cells, is_complete = _cells(options, "comparison.csv", compute)
    if not is_complete:
        return ExitStatus.INTERRUPTED
    draw_comparison(cells, further).savefig(options.out / "comparison.png", dpi=110)
    draw_break_points(cells).savefig(options.out / "error_over_delay.png", dpi=130)
    of_cg = draw_comparison(cells, further, of_cg=True)
    of_cg.savefig(options.out / "comparison_centre_of_gravity.png", dpi=110)
    markdown = "\n".join([*markdown_lines(cells, further), ""])
    (options.out / "comparison.md").write_text(markdown, encoding="utf-8")
    for line in table_lines(cells, further):
        print(line)
    elapsed_s = time.perf_counter() - begin_s
    print(f"\n{elapsed_s:.0f} s; tables and pictures are in {options.out}")
    return ExitStatus.OK


DELAY_S_MAX = 0.5
_SEED = 1
PREDICTORS = tuple(one for one in CONTESTANTS if one.label in ("predictor", "predictor, CG"))
"""One follows the preview point, the other the centre of gravity."""


class Point(NamedTuple):
    """A vehicle and a constant delay, and the RMS of its centre of gravity from SETTLED_S on."""

    cg_rms_m: float
    speed_m_s: float
    virtual_mass_kg: float
    delay_s: float


def interior_points(count: int, duration_s: float, contestant: Contestant) -> list[Point]:
    """Return points of a Sobol sequence over speed, mass and delay, the worst first."""
    from scipy.stats import qmc  # takes a second

    corners = paper_box().vertices()
    low, high = ((one.speed_m_s, one.virtual_mass_kg) for one in (corners[0], corners[-1]))
    unit = qmc.Sobol(3, seed=_SEED).random_base2(max(count - 1, 0).bit_length())[:count]
    places = qmc.scale(unit, (*low, 0.0), (*high, DELAY_S_MAX)).tolist()
    return sorted((_point(place, duration_s, contestant) for place in places), reverse=True)


def interior_line(contestant: Contestant, points: list[Point]) -> str:
    """Return what to know of them."""
    worst, median = points[0], points[len(points) // 2]
    return (
        f"{contestant.label}, {len(points)} points inside the box, delay up to {DELAY_S_MAX:g} s:"
        f" centre of gravity RMS from {SETTLED_S:g} s on {1e3 * worst.cg_rms_m:.2f} mm at most"
        f" ({3.6 * worst.speed_m_s:.2f} km/h, {worst.virtual_mass_kg:.0f} kg,"
        f" {1e3 * worst.delay_s:.0f} ms), median {1e3 * median.cg_rms_m:.2f} mm"
    )


def _point(place: tuple[float, float, float], duration_s: float, contestant: Contestant) -> Point:
    speed_m_s, mass_kg, delay_s = place
    plant = plant_settings(NETWORKS["constant"], delay_s, "a", 1, duration_s)
    vehicle = {"speed_m_s": speed_m_s, "virtual_mass_kg": mass_kg}
    plant = plant.model_copy(update={"vehicle": plant.vehicle.model_copy(update=vehicle)})
    *_, cg_rms_m = figures_m(plant, controller_settings(contestant, has_lag=False))
    return Point(cg_rms_m, speed_m_s, mass_kg, delay_s)


if __name__ == "__main__":
    sys.exit(main())
