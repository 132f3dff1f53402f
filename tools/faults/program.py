"""Inject thousands of faults in virtual time, and report which are detected, and how soon.

    steer-by-wire faults [SPEC.toml] [--out DIR]
    steer-by-wire faults --live

Runs every fault of the specification at every operating point with every law, and runs without a
fault. Leaves specification.toml, results.csv, campaign.json and index.html in DIR. With --live some
of the faults are also injected into real processes on the emulated bus, which takes seven minutes
more. The exit status is 1 where an acceptance fails.
"""

import argparse
import time
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

from steer_by_wire.closed_loop.parallel_work import worker_pool
from steer_by_wire.closed_loop.reports.findings import Finding, finding_lines
from steer_by_wire.closed_loop.reports.terminal import counting_bars, plain_console
from steer_by_wire.controller.settings import PRESETS
from steer_by_wire.runtime.command_line import (
    add_out_argument,
    command_parser,
    run_main,
    whole_number,
)
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.output_file import write_text
from steer_by_wire.runtime.program.report import refuse_another_run, write_json
from steer_by_wire.runtime.settings import (
    SettingsError,
    load_settings,
    preset_names,
    read_preset,
)
from steer_by_wire.runtime.settings.toml_text import dump_toml
from steer_by_wire.tools.faults.campaign.acceptance import findings_of
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings
from steer_by_wire.tools.faults.campaign.campaign_runs import Scenario, scenarios_of
from steer_by_wire.tools.faults.campaign.case_groups import group
from steer_by_wire.tools.faults.campaign.presentation import (
    campaign_page,
    table_lines,
    write_csv,
)
from steer_by_wire.tools.faults.campaign.virtual_trial import RunResult, run_trial
from steer_by_wire.tools.faults.live.live_campaign import (
    live_finding,
    live_section,
    run_live_campaign,
)

NAME = "steer-by-wire faults"
FAILED = 1
SPECIFICATION = "specification.toml"
"""Says what the results in a folder are of."""
_EXAMPLES = ("inject --list", "--set golden_seeds=1")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    examples = "\n".join(f"{NAME} {words}" for words in _EXAMPLES)
    usage = "[SPEC.toml | inject] [options]"
    parser = command_parser(NAME, __doc__, examples, usage)
    parser.add_argument(
        "spec",
        nargs="?",
        type=Path,
        metavar="SPEC.toml",
        help="default: the built-in specification",
    )
    parser.add_argument(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override one value of the specification; repeatable",
    )
    add_out_argument(parser, "out/faults")
    parser.add_argument(
        "--live", action="store_true", help="also run real processes, with logs in DIR/live"
    )
    parser.add_argument(
        "--workers",
        type=whole_number(1, 64),
        default=2,
        metavar="N",
        help="runs at once, up to 64 (default: %(default)s)",
    )
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    built_in = read_preset("steer_by_wire.tools.faults", "default")
    default = built_in if options.spec is None else None
    spec = load_settings(CampaignSettings, default, options.spec, options.overrides)
    known = preset_names(PRESETS)
    for law in (*spec.laws, *(law for point in spec.points for law in point.laws)):
        if law not in known:
            raise SettingsError(f"laws: {law!r} is no preset; known: {', '.join(known)}")
    folder, text = options.out, dump_toml(spec)
    refuse_another_run(folder, {SPECIFICATION: text})
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / SPECIFICATION, text)
    begin_s = time.perf_counter()
    results = run_all(list(scenarios_of(spec)), options.workers)
    findings = findings_of(results, spec.ftti_ms)
    live = run_live_campaign(folder / "live", spec.seed) if options.live else []
    findings += [live_finding(live)] if live else []
    groups = group(results)
    write_csv(folder / "results.csv", results)
    write_json(
        folder / "campaign.json",
        {
            "specification": spec.model_dump(mode="json"),
            "findings": {one.what: {"holds": one.holds, "figure": one.figure} for one in findings},
            "cases": {f"{one.kind} {one.magnitude:g} {one.where}": one._asdict() for one in groups},
        },
    )
    sections = [live_section(live)] if live else []
    html = campaign_page(spec, results, groups, findings, sections)
    write_text(folder / "index.html", html)
    print("\n".join([*table_lines(groups), "", *finding_lines(findings)]))
    elapsed_s = time.perf_counter() - begin_s
    print(f"\n{len(results)} runs, {elapsed_s:.0f} s; {folder / 'index.html'}")
    return _status(findings)


def run_all(scenarios: Sequence[Scenario], workers: int) -> list[RunResult]:
    """Run the scenarios in as many processes, and return their results in order."""
    results = []
    with counting_bars(plain_console()) as bars, worker_pool(workers) as pool:
        task = bars.add_task("", total=len(scenarios))
        made: Iterable[RunResult] = map(run_trial, scenarios)
        if workers > 1:
            made = pool.map(run_trial, scenarios)
        for result in made:
            results.append(result)
            bars.advance(task)
    return results


def _status(findings: Sequence[Finding]) -> int:
    return ExitStatus.OK if all(one.holds is not False for one in findings) else FAILED
