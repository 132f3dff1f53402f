"""``doctor --measure``: its nodes, its rule and its report; never how fast this machine is."""

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
from steer_by_wire.tools.doctor.kept_rate import is_kept, rate_kept_hz
from steer_by_wire.tools.doctor.measurement import (
    ECHO_ID,
    ORDINARY,
    PERIOD_NS,
    RATES_HZ,
    REAL_TIME,
    REQUEST_ID,
    EchoNode,
    Measured,
    Measurement,
    RequestNode,
    RoundTrip,
)
from steer_by_wire.tools.doctor.measurement_report import record_of, sentences
from steer_by_wire.tools.doctor.wake_ups import (
    PRESET,
    Figures,
    Sample,
    WakeUps,
    WorkingNode,
    figures_of,
)
from tests.support.programs.running_program import PATIENCE_S

ORDINARILY = ("--priority", "0", "--no-memory-lock")
PROGRAM = (sys.executable, "-m", "steer_by_wire.tools.doctor", "--measure")


class Clock:
    """A clock that the test sets, and that advances by a microsecond with each reading."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now_ns = now_ns

    def __call__(self) -> int:
        self.now_ns += 1000
        return self.now_ns


def summary(samples: int, p99_ns: int) -> DurationSummary:
    return DurationSummary(samples, 0.0, 0, p99_ns, p99_ns)


def wake_ups(
    rate_hz: int, lateness_share: float, done_share: float, missed: int = 0, served: int = 1000
) -> WakeUps:
    period_ns = NS_PER_S // rate_hz
    figures = Figures(
        summary(served, round(lateness_share * period_ns)),
        summary(served, round(done_share * period_ns)),
        missed,
    )
    return WakeUps(rate_hz, figures, 0.0)


# --- nodes --------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_the_working_node_works_each_period_and_sends_nothing(rate_hz: int) -> None:
    settings = controller_preset(PRESET, [f"rate_hz={rate_hz}"])
    period_ns, clock = NS_PER_S // rate_hz, Clock()
    node = WorkingNode(settings, 0, 20 * period_ns, clock)
    assert node.on_frame(Frame(0x110, bytes(8)), 0) == ()
    while not node.finished:
        clock.now_ns = node.deadline_ns + 5000
        assert node.on_tick(node.deadline_ns + 4000) == ()
    assert node.samples == [Sample(4000, 6000)] * 20


def test_missed_periods_are_distinguished_from_lateness() -> None:
    samples = [Sample(5, 10), Sample(99, 120), Sample(100, 130), Sample(350, 360)]
    figures = figures_of(samples, 100)
    assert figures.missed == 1 + 3
    assert (figures.lateness.max_ns, figures.done.max_ns) == (350, 360)


def test_the_echo_answers_requests_and_nothing_else() -> None:
    echo = EchoNode()
    assert echo.on_frame(Frame(REQUEST_ID, b"abc"), 0) == (Frame(ECHO_ID, b"abc"),)
    assert echo.on_frame(Frame(ECHO_ID, b"abc"), 0) == ()
    assert echo.on_frame(Frame(0x100, b"abc"), 0) == ()


def test_a_round_trip_ends_with_the_echo_of_the_last_request() -> None:
    clock = Clock()
    node = RequestNode(0, 4 * PERIOD_NS, clock)
    (first,) = node.on_tick(0)
    clock.now_ns += 40_000
    assert node.on_frame(Frame(ECHO_ID, first.data), 0) == ()
    node.on_frame(Frame(ECHO_ID, first.data), 0)  # a second echo is nobody's
    (second,) = node.on_tick(PERIOD_NS)
    (third,) = node.on_tick(2 * PERIOD_NS)
    node.on_frame(Frame(ECHO_ID, second.data), 0)
    node.on_frame(Frame(0x100, third.data), 0)
    finished = [node.finished]
    node.on_tick(3 * PERIOD_NS)
    finished.append(node.finished)
    assert finished == [False, True]
    assert node.times_ns == [41_000]
    assert node.unanswered == 2


# --- the rule -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lateness_share", "done_share", "missed", "kept"),
    [
        (0.0999, 0.499, 1, True),
        (0.101, 0.499, 0, False),
        (0.0999, 0.501, 0, False),
        (0.0999, 0.499, 2, False),
    ],
)
def test_each_part_of_the_rule_is_a_limit(
    lateness_share: float, done_share: float, missed: int, kept: bool
) -> None:
    assert is_kept(wake_ups(100, lateness_share, done_share, missed)) is kept


def test_nothing_measured_keeps_nothing() -> None:
    assert not is_kept(wake_ups(100, 0.0, 0.0, served=0))


def test_a_rate_counts_only_with_all_lower_ones() -> None:
    good, bad = (0.01, 0.1), (0.5, 0.9)
    assert rate_kept_hz([wake_ups(1000, *good), wake_ups(100, *good)]) == 1000
    assert rate_kept_hz([wake_ups(100, *good), wake_ups(500, *bad), wake_ups(1000, *good)]) == 100
    assert rate_kept_hz([wake_ups(100, *bad), wake_ups(500, *good)]) is None


# --- the report ---------------------------------------------------------------------------------


def measured(rights: str, **changes: Any) -> Measured:
    trip = RoundTrip(summary(9, 1000), 0, None)
    return Measured(
        rights,
        [HostAnswer("timer slack", True, "1 ns"), HostAnswer("memory lock", False, "no")],
        [wake_ups(rate_hz, 0.01, 0.1) for rate_hz in RATES_HZ],
        trip,
        "",
    )._replace(**changes)


def test_what_was_refused_is_said_and_the_rule_with_the_verdict() -> None:
    text = "\n".join(
        sentences(Measurement("a bus", "AF_CAN", [measured(ORDINARY)], "priority (no)"))
    )
    assert "no measurement with real-time rights: priority (no)" in text
    assert "memory lock: refused, no" in text
    assert "rule: a rate is kept if" in text
    assert text.endswith(f"verdict, {ORDINARY}: this machine keeps a controller at 1000 Hz")


def test_a_round_trip_that_could_not_be_measured_says_why() -> None:
    silent = RoundTrip(summary(0, 0), 99, None)
    probe = Measurement(
        "a bus",
        "AF_CAN",
        [
            measured(ORDINARY, round_trip=None, obstacle="it is in use"),
            measured(REAL_TIME, round_trip=silent, wake_ups=[wake_ups(100, 1.0, 1.0)]),
        ],
        "",
    )
    lines = list(sentences(probe))
    assert lines[0] == f"no round trip, {ORDINARY}: it is in use"
    assert lines[1].startswith(f"no echo, {REAL_TIME}: ")
    assert lines[-1] == f"verdict, {REAL_TIME}: this machine keeps not even 100 Hz"
    record = record_of(probe)
    assert record["measured"][0]["round_trip"] is None
    assert record["measured"][1]["rate_kept_hz"] is None


# --- the program --------------------------------------------------------------------------------


def run_probe(*options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*PROGRAM, *options], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )


@pytest.fixture(scope="module")
def probed(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, Any]]:
    """What the program prints and writes on an emulated bus of its own."""
    out = tmp_path_factory.mktemp("probe") / "probe.json"
    result = run_probe(*ORDINARILY, "--duration", "0.1", "-i", "emulated", "--json", str(out))
    assert result.returncode == 0, result.stderr
    return result.stdout, json.loads(out.read_text(encoding="utf-8"))


def test_the_record_has_every_figure(probed: tuple[str, dict[str, Any]]) -> None:
    _, record = probed
    assert record["driver"] == "python-can"
    assert record["real_time_refused"] == "not asked for"
    (ordinary,) = record["measured"]
    assert ordinary["is_real_time"] is False
    assert [each["rate_hz"] for each in ordinary["wake_ups"]] == list(RATES_HZ)
    for each in ordinary["wake_ups"]:
        figures = each["figures"]
        assert {"samples", "p50_s", "p99_s", "max_s"} <= figures["lateness"].keys()
        assert figures["done"]["samples"] == figures["lateness"]["samples"]
        periods = figures["lateness"]["samples"] + figures["missed"]
        assert periods >= round(0.1 * each["rate_hz"])
    trip = ordinary["round_trip"]
    assert trip["times"]["samples"] + trip["unanswered"] <= round(0.1 * NS_PER_S / PERIOD_NS)


def test_the_program_ends_with_its_verdict(probed: tuple[str, dict[str, Any]]) -> None:
    printed, record = probed
    assert f"rule: {record['rule']}" in printed.splitlines()
    assert printed.splitlines()[-1].startswith(f"verdict, {ORDINARY}: this machine keeps")


def test_an_interface_that_is_not_there_is_one_line_and_status_3() -> None:
    result = run_probe("-i", "socketcan", "-c", "nosuchcan0")
    assert result.returncode == 3
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("steer-by-wire doctor: error: cannot open socketcan nosuchcan0: ")


def test_control_c_ends_it_with_one_line_and_status_130() -> None:
    command = [*PROGRAM, *ORDINARILY, "--duration", "1000", "-i", "virtual", "-c", "stopped"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        assert "wake-ups at 100 Hz" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        printed, complaint = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert printed == ""
    assert complaint == "steer-by-wire doctor: error: interrupted\n"
