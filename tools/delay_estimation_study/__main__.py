"""Study how well the delay is estimated without an echo, over delays, paths, vehicles and laws.

    steer-by-wire delay-study --out out/delay_estimation

Runs the true nodes in virtual time on two processes and prints tables of the estimate's error
against the truth that only the rig knows (module ``runs``). Writes ``runs.csv`` with every run and
``delay_estimation.png`` to the folder. The results are the same every time.
"""

import argparse
import csv
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from steer_by_wire.closed_loop.reports.plot_style import COLOURS, plot_style
from steer_by_wire.closed_loop.worker_processes import worker_pool
from steer_by_wire.runtime.command_line import add_out_argument, command_parser
from steer_by_wire.runtime.program.program import run_main
from steer_by_wire.tools.delay_estimation_study.runs import (
    CORNERS,
    DISTURBANCES,
    DURATION_S,
    LAWS,
    NETWORKS,
    NO_DISTURBANCE,
    NOISES_M,
    PATHS,
    TOLERANCE_S,
    Case,
    History,
    Result,
    cases,
    run_case,
)

PROCESSES = 2
NAME = "steer-by-wire delay-study"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    return run_main(NAME, partial(_run, _parser().parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    options.out.mkdir(parents=True, exist_ok=True)
    todo = cases(
        options.laws, options.paths, options.networks, options.corners, options.disturbances
    )
    results = []
    with worker_pool(PROCESSES) as pool, (options.out / "runs.csv").open("w") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow([*Case._fields, *Result._fields[1:]])
        for number, result in enumerate(pool.map(_figures, todo), 1):
            results.append(result)
            table.writerow([*result.case, *result[1:]])
            file.flush()
            print(f"\r{number} of {len(todo)} runs", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
    text = report(results)
    (options.out / "tables.txt").write_text(text, encoding="utf-8")
    print(text, end="")
    picture = options.out / "delay_estimation.png"
    draw(picture, todo)
    print(f"wrote {picture}")
    return 0


def report(results: Sequence[Result]) -> str:
    """Return the tables, over all stable runs."""
    stable = [result for result in results if result.is_stable]
    tables = (
        _table("path", PATHS, "path", stable),
        _table("law", LAWS, "law", stable),
        _table("delay", NETWORKS, "network", stable),
        _table("corner", CORNERS, "corner", stable),
        _table("disturbance", DISTURBANCES, "disturbance", stable),
    )
    return "\n".join([f"{len(stable)} of {len(results)} runs are stable.\n", *tables])


def _table(heading: str, names: Iterable[str], field: str, results: Sequence[Result]) -> str:
    """Return the figures by a field of the cases."""
    lines = [
        f"| {heading} | noise | runs | observable | never | first, median / last | error 5 / 50 /"
        " 95 % | largest | within 10 ms | echo's error |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name in names:
        for noise_m in NOISES_M:
            group = [
                result
                for result in results
                if (getattr(result.case, field), result.case.noise_m) == (name, noise_m)
            ]
            if group:
                lines.append(f"| {name} | {100 * noise_m:g} cm | {_row(group)} |")
    return "\n".join(lines) + "\n"


def _row(group: Sequence[Result]) -> str:
    """Return the figures of some runs; the time that each was observable is its weight."""
    share = np.array([result.observable_share for result in group])
    seen = [result for result in group if result.observable_share > 0.0]
    echo = 1e3 * np.mean([result.echo_error_s for result in group])
    cells = [f"{len(group)}", f"{100 * share.mean():.0f} %", f"{len(group) - len(seen)}"]
    if not seen:
        return " | ".join([*cells, "-", "-", "-", "-", f"{echo:+.1f} ms"])
    first_s = [result.first_s for result in seen]
    low, middle, high = (
        1e3 * np.array([getattr(result, name) for result in seen])
        for name in ("error_p05_s", "error_p50_s", "error_p95_s")
    )
    within = np.average(
        [result.within_tolerance for result in seen],
        weights=[result.observable_share for result in seen],
    )
    largest = 1e3 * max(result.error_max_s for result in seen)
    cells += [
        f"{np.median(first_s):.1f} / {max(first_s):.1f} s",
        f"{low.min():+.1f} / {np.median(middle):+.1f} / {high.max():+.1f} ms",
        f"{largest:.1f} ms",
        f"{100 * within:.1f} %",
        f"{echo:+.1f} ms",
    ]
    return " | ".join(cells)


def _figures(case: Case) -> Result:
    return run_case(case)[0]


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        NAME,
        __doc__,
        f"{NAME} --laws pd_ddob --paths double_lane_change --networks 80_ms --corners a",
    )
    add_out_argument(parser, "out/delay_estimation")
    for option, names, default in (
        ("laws", LAWS, LAWS),
        ("paths", tuple(PATHS), tuple(PATHS)),
        ("networks", tuple(NETWORKS), tuple(NETWORKS)),
        ("corners", tuple(CORNERS), tuple(CORNERS)),
        ("disturbances", tuple(DISTURBANCES), (NO_DISTURBANCE,)),
    ):
        words = {re.sub(r"\W+", "_", name): name for name in names}
        parser.add_argument(
            f"--{option}",
            nargs="+",
            type=partial(_name_of, words),
            default=default,
            metavar=option.upper().removesuffix("S"),
            help=f"of {', '.join(words)} (default: {'all' if default == names else default[0]})",
        )
    return parser


def _name_of(words: Mapping[str, str], text: str) -> str:
    """Return the name that a word stands for; argparse turns the error into one line."""
    if text not in words:
        raise argparse.ArgumentTypeError(f"{text[:60]!r} is none of {', '.join(words)}")
    return words[text]


_LAW = "pd_ddob"
_NETWORKS = ("80 ms", "250 ms", "2 x 80 ± 30 ms")
_ROWS = (
    ("double lane change", "a", 0.0),
    ("double lane change", "d", 0.02),
    ("ellipse 60 x 30 m", "d", 0.0),
)
"""The cases shown, where they were requested; all of them would be too many for one picture."""
_SPAN_MS = 25.0
"""Range shown on either side of the truth."""


def shown(cases: Sequence[Case]) -> list[list[Case]]:
    """Return the cases of the panels, in rows of one path, corner and noise; one at the least.

    All have one law, and the first disturbance that was requested.
    """
    laws = [case.law for case in cases]
    law, disturbance = _LAW if _LAW in laws else laws[0], cases[0].disturbance
    rows = [
        [
            case
            for network in _NETWORKS
            for case in cases
            if case == Case(law, road, corner, network, noise_m, disturbance)
        ]
        for road, corner, noise_m in _ROWS
    ]
    return [row for row in rows if row] or [[cases[0]]]


def draw(path: Path, cases: Sequence[Case]) -> None:
    """Run what is shown of ``cases``, and write the picture."""
    rows = shown(cases)
    with plot_style():
        figure = Figure(figsize=(12.0, 8.0))
        axes = figure.subplots(len(rows), len(rows[0]), sharex=True, squeeze=False)
        for row, cases_of_row in enumerate(rows):
            for column, case in enumerate(cases_of_row):
                _panel(axes[row, column], run_case(case)[1])
                title = f"{case.path}, {case.corner}, {100 * case.noise_m:g} cm, {case.network}"
                if case.disturbance != NO_DISTURBANCE:
                    title += f", {case.disturbance}"
                axes[row, column].set_title(title, fontsize=8)
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        for axis in axes[:, 0]:
            axis.set_ylabel("delay [ms]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)
        figure.savefig(path)


def _panel(axis: Axes, history: History) -> None:
    truth_ms, tolerance_ms = 1e3 * history.truth_s, 1e3 * TOLERANCE_S
    axis.axhspan(
        truth_ms - tolerance_ms,
        truth_ms + tolerance_ms,
        color="0.9",
        label="truth ± one control period",
    )
    axis.axhline(truth_ms, color="0.4", linewidth=1.0, label="truth")
    axis.plot(
        history.time_s, 1e3 * history.echo_s, color=COLOURS[0], linewidth=1.0, label="by echo"
    )
    axis.plot(history.time_s, 1e3 * history.estimate_s, color=COLOURS[1], label="estimate")
    low_ms = truth_ms - _SPAN_MS
    nothing = np.where(np.isnan(history.estimate_s), low_ms + 1.0, np.nan)
    axis.plot(history.time_s, nothing, color=COLOURS[3], linewidth=4.0, label="not observable now")
    axis.set(ylim=(low_ms, truth_ms + _SPAN_MS), xlim=(0.0, DURATION_S))


if __name__ == "__main__":
    sys.exit(main())
