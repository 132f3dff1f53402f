"""Reproduce the figures and tables of SAE 2018-01-1086 with this project's models and laws.

    steer-by-wire paper [--figure N ...] [--table N ...] [--out DIR]

Writes to DIR a PNG for each picture and a JSON for each figure. ``index.html``, written
last, shows published and reproduced values of these side by side, with a verdict.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from concurrent.futures import as_completed
from functools import partial
from importlib import import_module
from pathlib import Path

from matplotlib.figure import Figure
from rich.console import Console

from steer_by_wire.closed_loop.processes.parallel_work import worker_pool
from steer_by_wire.closed_loop.reports.plot_style import plot_style
from steer_by_wire.closed_loop.reports.terminal import counting_bars, plain_console
from steer_by_wire.runtime.command_line import add_out_argument, command_parser, run_main
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.output_file import write_text
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.paper.index_page import index_page
from steer_by_wire.tools.paper.result import Reproduction, write_reproduction

MODULES = {
    "figure_07": "figures.parameter_space_figures",
    "figure_08": "figures.parameter_space_figures",
    "figure_09": "figures.small_gain_figures",
    "figure_10": "figures.frequency_figures",
    "figure_11": "figures.frequency_figures",
    "figure_12": "figures.small_gain_figures",
    **{f"figure_{number}": "figures.dob_figures" for number in range(16, 21)},
    "table_2": "table_2",
    **{f"figure_{number}": "figures.delay_figures" for number in range(21, 25)},
}
"""Where each figure and table is computed, by the key of its Reproduction, in the paper's order."""


def _named(key: str) -> tuple[str, str]:
    """Return the option and the value that select a figure or table."""
    kind, _, number = key.partition("_")
    return kind, number.lstrip("0")


def numbers_of(kind: str) -> tuple[str, ...]:
    """Return the numbers that ``--figure`` or ``--table`` takes."""
    return tuple(number for its_kind, number in map(_named, MODULES) if its_kind == kind)


NAME = "steer-by-wire paper"
WORKERS = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Reproduce what is requested; returns the exit status."""
    parser = command_parser(NAME, __doc__, f"{NAME} --figure 7 --table 2 --out out/paper")
    for kind in ("figure", "table"):
        parser.add_argument(
            f"--{kind}", action="append", default=[], metavar="N",
            help=f"repeatable: {', '.join(numbers_of(kind))}",
        )  # fmt: skip
    add_out_argument(parser, "out/paper")
    return run_main(NAME, partial(_reproduce, parser.parse_args(arguments)))


def _reproduce(options: argparse.Namespace) -> int:
    console = plain_console()
    keys = selected(options.figure, options.table)
    options.out.mkdir(parents=True, exist_ok=True)
    reproduce_all(keys, options.out, console)
    return ExitStatus.OK


def selected(figures: Sequence[str], tables: Sequence[str]) -> tuple[str, ...]:
    """Return the keys to compute, all where nothing is named; raises SettingsError."""
    wanted = [("figure", number) for number in figures] + [("table", number) for number in tables]
    for kind, number in wanted:
        if number not in (numbers := numbers_of(kind)):
            raise SettingsError(
                f"--{kind} {number}: nothing to compute; allowed are {', '.join(numbers)}"
            )
    return tuple(key for key in MODULES if not wanted or _named(key) in wanted)


def reproduce_all(keys: Sequence[str], out: Path, console: Console) -> None:
    """Compute and write in worker processes, then write the index page.

    A failure does not keep the others from being written; the first one is raised at the end.
    """
    start_s = time.perf_counter()
    written: list[Reproduction] = []
    failures: list[BaseException] = []
    tables_first = sorted(keys, reverse=True)  # they take longest
    with worker_pool(min(WORKERS, len(keys))) as pool, counting_bars(console) as bars:
        task = bars.add_task("", total=len(keys))
        running = {pool.submit(reproduce, key, str(out)): key for key in tables_first}
        for future in as_completed(running):
            bars.advance(task)
            failure, key = future.exception(), running[future]
            if failure is None:
                written.append(future.result())
                console.print(f"{key:18}  {written[-1].verdict}")
            else:
                console.print(f"{key:18}  failed: {failure}")
                failures.append(failure)
    index = write_index(out, written)
    elapsed_s = time.perf_counter() - start_s
    console.print(f"results: {len(keys) - len(failures)} in {elapsed_s:.0f} s, {index}")
    if failures:
        raise failures[0]


def reproduce(key: str, out: str) -> Reproduction:
    """Compute one and write its files, in a worker process; returns it without drawings."""
    module = import_module(f"steer_by_wire.tools.paper.{MODULES[key]}")
    with plot_style():
        made: Reproduction = getattr(module, "_".join(_named(key)))()
        write_reproduction(made, Path(out))
    drawn = (picture._replace(figure=Figure()) for picture in made.pictures)
    return made._replace(pictures=tuple(drawn))


def write_index(out: Path, written: Sequence[Reproduction]) -> Path:
    """Write the page of what was computed, in the order of the paper; returns its path."""
    in_order = sorted(written, key=lambda one: [*MODULES].index(one.key))
    index = out / "index.html"
    write_text(index, index_page(in_order, lambda name: (out / f"{name}.png").read_bytes()))
    return index


if __name__ == "__main__":
    sys.exit(main())
