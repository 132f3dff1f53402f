"""Every way in which a run of a program ends, each with its report, its line and its status."""

import errno
import json
import signal
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import can
import pytest
from can.interfaces.virtual import VirtualBus

from steer_by_wire.runtime.command_line import handled, run_main
from steer_by_wire.runtime.exit_status import ExitStatus, most_severe
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NEVER_NS
from steer_by_wire.runtime.program.run_node import run_node
from tests.support.programs.some_program import NAME, Options, Probe, SomeSettings, run
from tests.support.programs.some_program import channel as channel
from tests.support.programs.some_program import options as options
from tests.support.programs.some_program import presets as presets
from tests.support.programs.some_program import restored_signals as restored_signals

Capture = pytest.CaptureFixture[str]


class Sleeper(Probe):
    """A node that never has anything to do."""

    @property
    def deadline_ns(self) -> int:
        return NEVER_NS

    @property
    def finished(self) -> bool:
        return False


def vendor_error(name: str, code: int) -> Exception:
    error: Exception = type(name, (can.CanOperationError,), {})("the queue is full", code)
    return error


def interrupt() -> None:
    signal.raise_signal(signal.SIGINT)


def terminate() -> None:
    signal.raise_signal(signal.SIGTERM)


def hang_up() -> None:
    signal.raise_signal(signal.SIGHUP)


def test_a_run_ends_after_its_duration(options: Options, tmp_path: Path) -> None:
    file = tmp_path / "report.json"
    run(options("--duration", "0.001", "--json", str(file)), Sleeper())
    assert json.loads(file.read_text())["ended_by"] == "duration"


@pytest.mark.parametrize(
    ("send", "name"), [(interrupt, "SIGINT"), (terminate, "SIGTERM"), (hang_up, "SIGHUP")]
)
def test_a_signal_ends_a_run_with_its_report(
    options: Options, tmp_path: Path, send: Callable[[], None], name: str
) -> None:
    file = tmp_path / "report.json"
    node = Probe(ticks=10**6, on_tick_do=send)
    assert run(options("--json", str(file)), node) == ExitStatus.OK
    assert json.loads(file.read_text())["ended_by"] == name


def test_below_nohup_the_end_of_the_terminal_does_not_end_a_run(options: Options) -> None:
    node = Probe(ticks=3, on_tick_do=hang_up)
    with handled(signal.SIGHUP, signal.SIG_IGN):
        assert run(options(), node) == ExitStatus.OK
    assert node.finished


def test_a_second_signal_does_not_cost_the_report(options: Options, tmp_path: Path) -> None:
    file = tmp_path / "report.json"
    node = Probe(ticks=10**6, on_tick_do=interrupt, on_report_do=terminate)
    assert run(options("--json", str(file)), node) == ExitStatus.OK
    assert json.loads(file.read_text())["node"]["counts"] == {"lost": 2}


def test_a_signal_right_after_ready_ends_a_run_with_its_report(
    options: Options, tmp_path: Path
) -> None:
    file = tmp_path / "report.json"

    def make_node(_start_ns: int) -> Probe:
        terminate()
        return Sleeper()

    run_node(NAME, options("--json", str(file)), SomeSettings(), make_node)
    assert json.loads(file.read_text())["ended_by"] == "SIGTERM"


def test_a_bus_that_fails_ends_the_run_with_one_line_and_its_report(
    options: Options, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_arguments: object, **_options: object) -> None:
        raise can.CanOperationError("bus-off")

    monkeypatch.setattr(VirtualBus, "send", refuse)
    file = tmp_path / "report.json"
    node = Probe(sends=[Frame(0x100, b"x")])
    assert run(options("--json", str(file)), node) == ExitStatus.BUS
    assert capsys.readouterr().err == f"{NAME}: error: cannot send: bus-off\n"
    assert json.loads(file.read_text())["ended_by"] == "cannot send: bus-off"


class Faulty(Probe):
    """A node that finds a fault in itself."""

    def report(self) -> Mapping[str, Any]:
        return {"failure": "51 of the last 100 ticks overran, allowed are 50 of 100"}


def test_a_node_that_has_found_a_fault_in_itself_ends_with_its_report_and_a_status_of_its_own(
    options: Options, tmp_path: Path, capsys: Capture
) -> None:
    report = tmp_path / "report.json"
    assert run(options("--json", str(report)), Faulty()) == ExitStatus.SAFE_STATE
    reported = capsys.readouterr()
    fault = "safe state: 51 of the last 100 ticks overran, allowed are 50 of 100"
    assert reported.err == f"{NAME}: error: {fault}\n"
    assert f"ended by {fault}" in reported.out
    written = json.loads(report.read_text())
    assert written["ended_by"] == fault
    assert written["node"]["failure"] in fault


def test_what_broke_a_run_decides_its_status_before_what_the_run_was_like() -> None:
    order = "SETTINGS", "BUS", "SAFE_STATE", "CONDITION", "OUTPUT", "OK"
    ranked = [ExitStatus[name] for name in order]
    for first, status in enumerate(ranked):
        assert most_severe(*reversed(ranked[first:])) is status


@pytest.mark.parametrize(
    "error",
    [
        can.CanTimeoutError("no room to send"),
        can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS),
        can.CanOperationError("Transmit buffer full"),
        OSError(errno.EAGAIN, "Resource temporarily unavailable"),
        vendor_error("PcanCanOperationError", 0x80),
        vendor_error("CANLIBOperationError", -13),
        vendor_error("VectorOperationError", 11),
    ],
    ids=str,
)
def test_a_full_transmit_queue_costs_frames_and_not_the_run(
    options: Options, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def refuse(*_arguments: object, **_options: object) -> None:
        raise error

    monkeypatch.setattr(VirtualBus, "send", refuse)
    file = tmp_path / "report.json"
    node = Probe(ticks=3, sends=[Frame(0x100, b"x")])
    assert run(options("--json", str(file)), node) == ExitStatus.OK
    loop = json.loads(file.read_text())["loop"]
    assert (loop["frames_sent"], loop["frames_refused"]) == (0, 3)


def test_a_bus_that_cannot_be_opened_is_one_line_and_makes_no_node(
    options: Options, tmp_path: Path, capsys: Capture
) -> None:
    asked = options("--json", str(tmp_path / "report.json"))
    asked.interface = "nonesuch"
    status = run_main(
        NAME, lambda: run_node(NAME, asked, SomeSettings(), lambda _: pytest.fail("made"))
    )
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert line.startswith(f"{NAME}: error: cannot open nonesuch ")
    assert (status, captured.out) == (ExitStatus.BUS, "")
    assert not (tmp_path / "report.json").exists()


def test_what_a_program_adds_comes_after_the_report_and_is_safe_from_signals(
    options: Options, tmp_path: Path
) -> None:
    file, done = tmp_path / "report.json", []

    def conclude(node: Probe) -> None:
        terminate()
        done.append((node.finished, file.exists()))

    asked = options("--json", str(file))
    status = run_node(NAME, asked, SomeSettings(), lambda _: Probe(), conclude)
    assert (status, done) == (ExitStatus.OK, [(True, True)])
