"""Reproduce the figures and tables of SAE 2018-01-1086 with this project's models and laws.

    steer-by-wire paper [--figure N ...] [--table N ...] [--out DIR]

Writes to DIR a PNG for each picture and a JSON for each figure. ``index.html``, written
last, shows published and reproduced values of these side by side, with a verdict.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure
from rich.console import Console

from steer_by_wire.closed_loop.processes.parallel_work import worker_pool
from steer_by_wire.closed_loop.reports.plot_style import plot_style
from steer_by_wire.closed_loop.reports.terminal import counting_bars, plain_console
from steer_by_wire.runtime.command_line import add_out_argument, command_parser, run_main
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.output_file import write_text
from steer_by_wire.runtime.program.output_folder import refuse_another_run
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.paper.index_page import index_page
from steer_by_wire.tools.paper.result import Reproduction, write_reproduction


class Entry(NamedTuple):
    """One figure or table.

    ``key``                 as in its Reproduction, and the stem of its files
    ``kind``, ``number``    what selects it: --figure 8, --table 2
    ``module``, ``name``    of the function without arguments that computes it, in this folder
    """

    key: str
    kind: str
    number: str
    module: str
    name: str


def _figure(number: int, module: str) -> Entry:
    return Entry(
        f"figure_{number:02d}", "figure", str(number), f"figures.{module}", f"figure_{number}"
    )


ENTRIES = (
    _figure(7, "parameter_space_figures"),
    _figure(8, "parameter_space_figures"),
    _figure(9, "small_gain_figures"),
    _figure(10, "frequency_figures"),
    _figure(11, "frequency_figures"),
    _figure(12, "small_gain_figures"),
    *(_figure(number, "dob_figures") for number in range(16, 21)),
    Entry("table_2", "table", "2", "table_2", "table_2"),
    *(_figure(number, "delay_figures") for number in range(21, 25)),
)
"""In the order of the paper, which is the order of the index page."""


def numbers_of(kind: str) -> tuple[str, ...]:
    """Return the numbers that ``--figure`` or ``--table`` takes, each once."""
    return tuple(dict.fromkeys(entry.number for entry in ENTRIES if entry.kind == kind))


def entry_of(key: str) -> Entry:
    """Return the entry with a key; raises KeyError where there is none."""
    return {entry.key: entry for entry in ENTRIES}[key]


def function_of(entry: Entry) -> Callable[[], Reproduction]:
    """Import and return the function that computes an entry."""
    function: Callable[[], Reproduction] = getattr(
        import_module(f"steer_by_wire.tools.paper.{entry.module}"), entry.name
    )
    return function


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
    entries = selected(options.figure, options.table)
    refuse_another_run(options.out, {})
    options.out.mkdir(parents=True, exist_ok=True)
    reproduce_all(entries, options.out, console)
    return ExitStatus.OK


def selected(figures: Sequence[str], tables: Sequence[str]) -> tuple[Entry, ...]:
    """Return what to compute, all where nothing is named; raises SettingsError."""
    wanted = [("figure", number) for number in figures] + [("table", number) for number in tables]
    for kind, number in wanted:
        numbers = numbers_of(kind)
        if number not in numbers:
            raise SettingsError(
                f"--{kind} {number}: nothing to compute; allowed are {', '.join(numbers)}"
            )
    chosen = (entry for entry in ENTRIES if (entry.kind, entry.number) in wanted)
    return tuple(chosen) if wanted else ENTRIES


def reproduce_all(entries: Sequence[Entry], out: Path, console: Console) -> None:
    """Compute and write in worker processes, then write the index page.

    A failure does not keep the others from being written; the first one is raised at the end.
    """
    start_s = time.perf_counter()
    written: list[Reproduction] = []
    failures: list[BaseException] = []
    tables_first = sorted(entries, key=lambda entry: entry.kind != "table")  # they take longest
    with worker_pool(min(WORKERS, len(entries))) as pool, counting_bars(console) as bars:
        task = bars.add_task("", total=len(entries))
        running = {pool.submit(reproduce, entry.key, str(out)): entry for entry in tables_first}
        for future in as_completed(running):
            bars.advance(task)
            failure, key = future.exception(), running[future].key
            if failure is None:
                written.append(future.result())
                console.print(f"{key:18}  {written[-1].verdict}")
            else:
                console.print(f"{key:18}  failed: {failure}")
                failures.append(failure)
    index = write_index(out, written)
    elapsed_s = time.perf_counter() - start_s
    console.print(f"{len(entries) - len(failures)} results in {elapsed_s:.0f} s: {index}")
    if failures:
        raise failures[0]


def reproduce(key: str, out: str) -> Reproduction:
    """Compute one entry and write its files, in a worker process; returns it without drawings."""
    with plot_style():
        made = function_of(entry_of(key))()
        write_reproduction(made, Path(out))
    drawn = (picture._replace(figure=Figure()) for picture in made.pictures)
    return made._replace(pictures=tuple(drawn))


def write_index(out: Path, written: Sequence[Reproduction]) -> Path:
    """Write the page of what was computed, in the order of the paper; returns its path."""
    keys = [entry.key for entry in ENTRIES]
    in_order = sorted(written, key=lambda one: keys.index(one.key))
    index = out / "index.html"
    page = index_page(in_order, lambda name: (out / f"{name}.png").read_bytes())
    write_text(index, page)
    return index


if __name__ == "__main__":
    sys.exit(main())
