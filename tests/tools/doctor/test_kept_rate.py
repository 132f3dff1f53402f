"""``doctor --measure``: its node, its rule and its report; never how fast this machine is."""

import json
import signal
import subprocess
import sys
from typing import Any

import pytest

from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.node.statistics import DurationSummary
from steer_by_wire.runtime.program.priority_and_memory_lock import HostAnswer
from steer_by_wire.tools.doctor.kept_rate import (
    ORDINARY,
    PRESET,
    RATES_HZ,
    REAL_TIME,
    Measured,
    Periods,
    WorkingNode,
    rate_kept_hz,
    sentences,
)
from tests.support.programs.running_program import PATIENCE_S

PROGRAM = (sys.executable, "-m", "steer_by_wire.tools.doctor", "--measure")
ORDINARILY = ("--priority", "0", "--no-memory-lock")
GOOD, BAD = (0.01, 0.1), (0.5, 0.9)


def periods(
    rate_hz: int, lateness_share: float, done_share: float, missed: int = 0, served: int = 1000
) -> Periods:
    late_ns, done_ns = (round(share * NS_PER_S / rate_hz) for share in (lateness_share, done_share))
    lateness, done = (DurationSummary(served, 0.0, 0, ns, ns) for ns in (late_ns, done_ns))
    return Periods(rate_hz, lateness, done, missed, 0.0)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_the_node_works_each_period_and_sends_nothing(rate_hz: int) -> None:
    settings = controller_preset(PRESET, [f"rate_hz={rate_hz}"])
    period_ns = NS_PER_S // rate_hz
    node = WorkingNode(settings, 0, 20 * period_ns, lambda: node.deadline_ns - period_ns + 6000)
    assert node.on_frame(Frame(0x110, bytes(8)), 0) == ()
    while not node.finished:
        assert node.on_tick(node.deadline_ns + 4000) == ()
    assert (node.lateness.summary().max_ns, node.lateness.summary().samples) == (4000, 20)


def test_missed_periods_are_counted() -> None:
    node = WorkingNode(controller_preset(PRESET), 0, NS_PER_S)
    for late_ns in (5, 9_999_999, 10_000_000, 35_000_000):
        node.on_tick(node.deadline_ns + late_ns)
    assert node.missed == 1 + 3


@pytest.mark.parametrize(
    ("lateness_share", "done_share", "missed", "is_kept"),
    [
        (0.0999, 0.499, 1, True),
        (0.101, 0.499, 0, False),
        (0.0999, 0.501, 0, False),
        (0.0999, 0.499, 2, False),
    ],
)
def test_each_part_of_the_rule_is_a_limit(
    lateness_share: float, done_share: float, missed: int, is_kept: bool
) -> None:
    assert periods(100, lateness_share, done_share, missed).is_kept is is_kept


def test_nothing_measured_keeps_nothing() -> None:
    assert not periods(100, 0.0, 0.0, served=0).is_kept


def test_a_rate_counts_only_with_all_lower_ones() -> None:
    assert rate_kept_hz([periods(1000, *GOOD), periods(100, *GOOD)]) == 1000
    assert rate_kept_hz([periods(100, *GOOD), periods(500, *BAD), periods(1000, *GOOD)]) == 100
    assert rate_kept_hz([periods(100, *BAD), periods(500, *GOOD)]) is None


def test_what_was_refused_is_said_and_the_rule_with_the_verdict() -> None:
    answers = [HostAnswer("timer slack", True, "1 ns"), HostAnswer("memory lock", False, "no")]
    measured = [
        Measured(ORDINARY, answers, [periods(rate_hz, *GOOD) for rate_hz in RATES_HZ]),
        Measured(REAL_TIME, answers, [periods(rate_hz, *BAD) for rate_hz in RATES_HZ]),
    ]
    refused, slack, lock, rule, *verdicts = sentences(measured, "priority (no)")
    assert refused == "no measurement with real-time rights: priority (no)"
    assert (slack, lock) == ("timer slack: 1 ns", "memory lock: refused, no")
    assert rule.startswith("rule: a rate is kept if")
    assert verdicts == [
        f"verdict, {ORDINARY}: this machine keeps a controller at 1000 Hz",
        f"verdict, {REAL_TIME}: this machine keeps not even 100 Hz",
    ]


def test_the_program_writes_every_figure_and_ends_with_its_verdict(tmp_path: Any) -> None:
    out = tmp_path / "figures.json"
    command = [*PROGRAM, *ORDINARILY, "--duration", "0.1", "--json", str(out)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    printed, record = ended.stdout.splitlines(), json.loads(out.read_text(encoding="utf-8"))
    assert f"rule: {record['rule']}" in printed
    assert printed[-1].startswith(f"verdict, {ORDINARY}: this machine keeps")
    assert record["real_time_refused"] == "not asked for"
    (ordinary,) = record["measured"]
    assert [each["rate_hz"] for each in ordinary["wake_ups"]] == list(RATES_HZ)
    for each in ordinary["wake_ups"]:
        assert {"samples", "p50_s", "p99_s", "max_s"} <= each["lateness"].keys()
        assert each["done"]["samples"] == each["lateness"]["samples"]
        assert each["lateness"]["samples"] + each["missed"] >= round(0.1 * each["rate_hz"])


def test_control_c_ends_it_with_one_line_and_status_130() -> None:
    command = [*PROGRAM, *ORDINARILY, "--duration", "1000"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        assert "wake-ups at 100 Hz" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        printed, complaint = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, printed) == (130, "")
    assert complaint == "steer-by-wire doctor: error: interrupted\n"
