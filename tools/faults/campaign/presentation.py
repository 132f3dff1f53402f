"""A campaign in the terminal, as CSV and as one page of HTML."""

import csv
from collections.abc import Callable, Sequence
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from ....closed_loop.reports.findings import HOLDS, Finding
from ....closed_loop.reports.page import Cell, Section, Table, number, page
from ....runtime.output_file import open_text
from .campaign_file import CampaignSettings
from .campaign_runs import GOLDEN, laws_of
from .case_groups import Group, in_ms, in_percent
from .virtual_trial import FAILURES, RunResult

_FAILED_SHOWN = 50
_DEFINITIONS = (
    "FDTI runs from the fault's first effect on its receiver to the first count of an expected "
    "cause in that receiver's own report; FRTI from there until it leaves control, where nothing "
    "is left to act on; FHTI is their sum. Elsewhere the reaction is to refuse the frame at once, "
    "or there is none. Accepted: of the frames that the fault has made of true ones, or added to "
    "them, the share that the receiver accepted; with a verdict of 'detected, followed' it went on "
    "to accept them after it had seen the fault. What the plant sees behind its latency line "
    "(silence, limiter) counts from when the effect has come out of it, with the latency of the "
    "last command that did. Reported: until the node sends the first frame that says so. Recovery: "
    "from the fault's end until both nodes are in control again. Times are the longest of all "
    "runs, in milliseconds, shares in percent.",
    "Which mechanism can detect a fault is decided by what the fault is, before any run. A fault "
    "that is not detectable shows a receiver nothing that differs from a sound sender; its "
    "deviation says what that costs.",
)


class _Column(NamedTuple):
    """A column of the table of cases, in the terminal and on the page."""

    heading: str
    text: Callable[[Group], str]
    is_number: bool = False


_COLUMNS = (
    _Column("fault", lambda one: f"{one.kind} {one.magnitude:g}" if one.where else one.kind),
    _Column("of", attrgetter("where")),
    _Column("can be seen by", attrgetter("expected")),
    _Column("seen by, first", lambda one: one.detected_by or one.counted),
    _Column("FDTI [ms]", lambda one: in_ms(one.fdti_s), True),
    _Column("FRTI [ms]", lambda one: in_ms(one.frti_s), True),
    _Column("FHTI [ms]", lambda one: in_ms(one.fhti_s), True),
    _Column("reported [ms]", lambda one: in_ms(one.reported_s), True),
    _Column("accepted [%]", lambda one: in_percent(one.accepted), True),
    _Column("recovery [ms]", lambda one: _recovery(one), True),
    _Column("deviation [m]", lambda one: f"{one.lateral_error_peak_m:.3f}", True),
    _Column("rate [rad/s]", lambda one: f"{one.steer_rate_peak_rad_s:.1f}", True),
    _Column("verdicts", attrgetter("verdicts")),
)


def table_lines(groups: Sequence[Group]) -> list[str]:
    """Return the table for a terminal: a line for each case."""
    texts = [[column.heading for column in _COLUMNS]]
    texts += [[column.text(one) for column in _COLUMNS] for one in groups]
    widths = [max(map(len, cells)) for cells in zip(*texts, strict=True)]
    return [
        "  ".join(
            text.rjust(width) if column.is_number else text.ljust(width)
            for column, text, width in zip(_COLUMNS, line, widths, strict=True)
        ).rstrip()
        for line in texts
    ]


def write_csv(path: Path, results: Sequence[RunResult]) -> None:
    """Write a line for each run."""
    with open_text(path) as opened:
        writer = csv.writer(opened)
        writer.writerow(RunResult._fields)
        for result in results:
            counts = " ".join(f"{cause}={count}" for cause, count in result.counts.items())
            writer.writerow(result._replace(counts=counts))  # type: ignore[arg-type]


def campaign_page(
    spec: CampaignSettings,
    results: Sequence[RunResult],
    groups: Sequence[Group],
    findings: Sequence[Finding],
    further: Sequence[Section] = (),
) -> str:
    """Return the page; ``further`` sections come behind the cases."""
    golden = sum(result.kind == GOLDEN for result in results)
    failed = [result for result in results if result.verdict in FAILURES]
    sections = [
        Section(
            "Acceptance",
            [
                f"{len(results)} runs of {spec.motion_s:g} s of motion in virtual time, {golden} "
                f"of them without a fault: {len(groups) - (golden > 0)} cases at "
                f"{len(spec.points)} operating points, each with its laws. Each fault lasts "
                f"{spec.fault_s:g} s; the fault tolerant time interval is {spec.ftti_ms:g} ms. "
                f"Campaign seed {spec.seed}."
            ],
            tables=[_findings_table(findings)],
        )
    ]
    sections.append(Section("Cases", _DEFINITIONS, tables=[_cases_table(groups)]))
    sections += further
    sections.append(Section("Why a fault can be seen, or cannot", [], tables=[_why_table(groups)]))
    how_many = f"{len(failed)} of {len(results)}." if failed else "None."
    sections.append(Section("Runs that failed", [how_many], tables=[_failed_table(failed)]))
    sections.append(Section("Operating points", [], tables=[_points_table(spec)]))
    failing = sum(finding.holds is False for finding in findings)
    verdict = (
        Cell(f"{failing} of {len(findings)} criteria fail", "poor")
        if failing
        else Cell(f"none of {len(findings)} criteria fails", "good")
    )
    return page("Fault campaign", sections, verdict)


def _findings_table(findings: Sequence[Finding]) -> Table:
    rows = [[Cell(HOLDS[one.holds]), Cell(one.what), Cell(one.figure)] for one in findings]
    return Table(("holds", "what", "figure"), rows)


def _cases_table(groups: Sequence[Group]) -> Table:
    rows = [
        [(number if column.is_number else Cell)(column.text(one)) for column in _COLUMNS]
        for one in groups
    ]
    return Table([column.heading for column in _COLUMNS], rows)


def _why_table(groups: Sequence[Group]) -> Table:
    """Return what was expected of each kind of fault; equal reasons are one row."""
    reasons: dict[tuple[str, str, str], list[str]] = {}
    for one in groups:
        case = f"{one.magnitude:g} {one.where}"
        reasons.setdefault((one.kind, one.expected, one.why), []).append(case)
    rows = [
        [Cell(kind), Cell(", ".join(cases)), Cell(expected), Cell(why)]
        for (kind, expected, why), cases in reasons.items()
    ]
    return Table(("fault", "magnitude and message", "can be seen by", "because"), rows)


def _failed_table(failed: Sequence[RunResult]) -> Table:
    rows = []
    for one in failed[:_FAILED_SHOWN]:
        counted = ", ".join(f"{cause} {n}" for cause, n in one.counts.items())
        times = number(in_ms(one.fdti_s)), number(in_ms(one.fhti_s))
        what = Cell(one.unsafe or one.jumps or counted)
        rows.append([Cell(one.name), Cell(str(one.verdict)), *times, what])
    return Table(("run", "verdict", "FDTI", "FHTI", "counted"), rows)


def _points_table(spec: CampaignSettings) -> Table:
    rows = [
        [
            Cell(point.name),
            number(f"{point.speed_m_s:.3g}"),
            number(f"{point.virtual_mass_kg:g}"),
            number(f"{point.downlink_ms:g}"),
            number(f"{point.uplink_ms:g}"),
            number(f"{point.jitter_ms:g}"),
            number(f"{point.noise_m:g}"),
            Cell("ellipse" if point.path is None else point.path.kind.replace("_", " ")),
            Cell(", ".join(laws_of(spec, point))),
        ]
        for point in spec.points
    ]
    headings = (
        *("point", "speed [m/s]", "mass [kg]", "downlink [ms]", "uplink [ms]"),
        *("jitter [ms]", "noise [m]", "path", "laws"),
    )
    return Table(headings, rows)


def _recovery(one: Group) -> str:
    return in_ms(one.recovery_s) if one.recovered == one.runs else "never"
