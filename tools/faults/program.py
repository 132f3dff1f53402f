"""Inject thousands of faults in virtual time, and report which are detected, and how soon.

    steer-by-wire faults [SPEC.toml] [--out DIR]
    steer-by-wire faults --live

Runs every fault of the specification at every operating point with every law, and runs without a
fault. Leaves results.jsonl, results.csv, campaign.json and index.html in DIR; run again, it
continues where it stopped. A folder with results of another specification, or of programs that have
changed since, is rejected. With --live some of the faults are also injected into real processes on
the emulated bus, which takes seven minutes more. The exit status is 1 where an
acceptance fails.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from steer_by_wire.closed_loop.reports.findings import Finding, finding_lines
from steer_by_wire.closed_loop.reports.terminal import counting_bars, plain_console
from steer_by_wire.runtime.command_line import (
    add_out_argument,
    command_parser,
    run_main,
    say,
    whole_number,
)
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.output_file import write_text
from steer_by_wire.runtime.program.output_folder import refuse_another_run
from steer_by_wire.runtime.program.report import write_json
from steer_by_wire.runtime.settings import SettingsError, load_settings, read_preset
from steer_by_wire.tools.faults.campaign.acceptance import findings_of
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings
from steer_by_wire.tools.faults.campaign.campaign_runs import scenarios_of
from steer_by_wire.tools.faults.campaign.case_groups import group
from steer_by_wire.tools.faults.campaign.execution import (
    RESULTS,
    execute,
    keep_only,
    read_stored,
    specification_hash,
    write_result,
)
from steer_by_wire.tools.faults.campaign.presentation import campaign_page, table_lines, write_csv
from steer_by_wire.tools.faults.campaign.virtual_trial import RunResult, run_trial
from steer_by_wire.tools.faults.live.live_campaign import (
    live_finding,
    live_section,
    run_live_campaign,
)

NAME = "steer-by-wire faults"
FAILED = 1
_EXAMPLES = ("inject --list", "--set golden_seeds=1")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    examples = "\n".join(f"{NAME} {words}" for words in _EXAMPLES)
    usage = "[SPEC.toml | inject] [options]"
    parser = command_parser(NAME, __doc__, examples, usage)
    parser.add_argument(
        "spec", nargs="?", type=Path, metavar="SPEC.toml",
        help="default: the built-in specification",
    )  # fmt: skip
    parser.add_argument(
        "--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE",
        help="override one value of the specification; repeatable",
    )  # fmt: skip
    add_out_argument(parser, "out/faults")
    parser.add_argument(
        "--live", action="store_true", help="also run real processes, with logs in DIR/live"
    )
    parser.add_argument(
        "--workers", type=whole_number(1, 64), default=2, metavar="N",
        help="runs at once, up to 64 (default: %(default)s)",
    )  # fmt: skip
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    built_in = read_preset("steer_by_wire.tools.faults", "default")
    default = built_in if options.spec is None else None
    spec = load_settings(CampaignSettings, default, options.spec, options.overrides)
    begin_s = time.perf_counter()
    results = _results(spec, options)
    findings = findings_of(results, spec.ftti_ms)
    live = run_live_campaign(options.out / "live", spec.seed) if options.live else []
    findings += [live_finding(live)] if live else []
    groups = group(results)
    folder = options.out
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


def _results(spec: CampaignSettings, options: argparse.Namespace) -> list[RunResult]:
    scenarios = list(scenarios_of(spec))
    refuse_another_run(options.out, {})
    spec_hash = specification_hash(spec)
    stored = read_stored(options.out, spec_hash)
    if stored.others:
        raise SettingsError(
            f"{options.out / RESULTS}: has {stored.others} results of another specification, or of"
            " programs that have changed since; give --out another folder, or remove this one"
        )
    if stored.not_whole:
        what = f"{stored.not_whole} lines that are no whole results are left out"
        say(NAME, f"{options.out / RESULTS}: {what}", sys.stderr)
    options.out.mkdir(parents=True, exist_ok=True)
    done = {result.name: result for _, result in stored.results}
    keep_only(options.out, spec_hash, done.values())
    left = [scenario for scenario in scenarios if scenario.name not in done]
    if done:
        print(f"{len(done)} of {len(scenarios)} runs are there already")

    try:
        with counting_bars(plain_console()) as bars:
            task = bars.add_task("", total=len(left))

            def take(result: RunResult) -> None:
                done[result.name] = result
                write_result(options.out, spec_hash, result)
                bars.advance(task)

            execute(run_trial, left, options.workers, take)
    except KeyboardInterrupt:
        kept = f"{len(done)} of {len(scenarios)} runs are kept in {options.out}"
        say(NAME, f"{kept}; the same command continues with the others", sys.stderr)
        raise
    return [done[scenario.name] for scenario in scenarios]


def _status(findings: Sequence[Finding]) -> int:
    return ExitStatus.OK if all(one.holds is not False for one in findings) else FAILED
