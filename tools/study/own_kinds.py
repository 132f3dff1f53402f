"""Studies that are no grid of runs: what each prints and writes."""

import argparse
import csv
import importlib
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from ...closed_loop.reports.plot_style import png_of
from ...closed_loop.reports.terminal import plain_console
from ...runtime.exit_status import ExitStatus
from ...runtime.output_file import write_file, write_text
from ...runtime.settings import SettingsError


class Results(NamedTuple):
    """The results: lines for the screen, rows for a file with their head first, and a picture."""

    lines: Sequence[str]
    rows: Iterable[Sequence[object]]
    picture: Figure


def run_own_kind(kind: str, options: argparse.Namespace) -> int:
    """Compute a study, print its lines, and write KIND.csv and KIND.png."""
    if options.replay is not None or options.scheduler:
        raise SettingsError(f"{options.study}: {kind} has neither --replay nor --scheduler")
    folder = options.out or Path("out/study") / kind
    own = importlib.import_module(f"{__package__}.{kind}")
    settings, size = own.read(options.study)
    print_line = plain_console().print
    print_line(f"study: {kind}: {settings.title}")
    print_line(size)
    if options.dry_run:
        return ExitStatus.OK
    results: Results = own.results_of(settings)
    for line in results.lines:
        print_line(line)
    folder.mkdir(parents=True, exist_ok=True)
    stream = io.StringIO(newline="")
    csv.writer(stream, lineterminator="\n").writerows(results.rows)
    table, picture = folder / f"{kind}.csv", folder / f"{kind}.png"
    write_text(table, stream.getvalue())
    write_file(picture, png_of(results.picture))
    print_line(f"results: {table}, {picture}")
    return ExitStatus.OK
