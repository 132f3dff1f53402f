"""What the two programs share, with a node that does little and python-can's bus in one process."""

import argparse
import errno
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import can
import pytest
from can.interfaces.virtual import VirtualBus

from runtime.bus import BusError
from runtime.frame import Frame
from runtime.node import NEVER_NS
from runtime.option_types import output_file
from runtime.program import (
    ExitStatus,
    StopRequest,
    load_program_settings,
    make_parser,
    run_main,
    run_node,
)
from runtime.settings import Settings, SettingsError

NAME = "some-program"
ORDINARY = ("--priority", "0", "--no-memory-lock")
Capture = pytest.CaptureFixture[str]


class SomeSettings(Settings):
    gain: float = 1.0
    words: str = ""


class Probe:
    """A node that ticks ``ticks`` times, at every wake-up, and does ``on_tick_do`` each time."""

    def __init__(
        self,
        ticks: int = 3,
        on_tick_do: Callable[[], None] = lambda: None,
        on_report_do: Callable[[], None] = lambda: None,
        sends: Sequence[Frame] = (),
    ) -> None:
        self._deadline_ns = 0
        self._ticks_left = ticks
        self._on_tick_do = on_tick_do
        self._on_report_do = on_report_do
        self._sends = sends

    @property
    def deadline_ns(self) -> int:
        return self._deadline_ns

    @property
    def finished(self) -> bool:
        return not self._ticks_left

    def on_frame(self, _frame: Frame, _now_ns: int) -> Sequence[Frame]:
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        self._deadline_ns = now_ns + 1
        self._ticks_left -= 1
        self._on_tick_do()
        return self._sends

    def report(self) -> Mapping[str, Any]:
        self._on_report_do()
        return {"rms_m": float("nan"), "counts": {"lost": 2}}


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


@pytest.fixture
def presets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    directory = tmp_path / "some_presets"
    directory.mkdir()
    (directory / "__init__.py").write_text("")
    (directory / "strong.toml").write_text("gain = 2.0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    return directory.name


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> str:
    return str(request.node.name)


@pytest.fixture
def options(presets: str, channel: str) -> Callable[..., argparse.Namespace]:
    def parse(*arguments: str) -> argparse.Namespace:
        bus = ("-i", "virtual", "-c", channel)
        return make_parser(NAME, "Does little.", presets).parse_args([*bus, *ORDINARY, *arguments])

    return parse


@pytest.fixture(autouse=True)
def _signals() -> Iterator[None]:
    """No test leaves a handler behind, or dies of a signal that it sends itself."""
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before[0])
    signal.signal(signal.SIGTERM, before[1])


Options = Callable[..., argparse.Namespace]


def run(options: argparse.Namespace, node: Probe) -> ExitStatus:
    return run_node(NAME, options, SomeSettings(), lambda _start_ns: node)


def interrupt() -> None:
    signal.raise_signal(signal.SIGINT)


def terminate() -> None:
    signal.raise_signal(signal.SIGTERM)


# A run and its report


def test_a_run_leaves_a_report_of_settings_loop_host_and_node(
    options: Options, tmp_path: Path
) -> None:
    file = tmp_path / "report.json"
    node = Probe(ticks=3, sends=[Frame(0x100, b"x")])
    assert run(options("--report", str(file)), node) == ExitStatus.OK
    report = json.loads(file.read_text())
    assert report["program"] == NAME
    assert report["ended_by"] == "finished"
    assert report["bus"].endswith("(from the command line)")
    assert report["settings"] == {"gain": 1.0, "words": ""}
    assert report["loop"]["lateness"]["samples"] == 3
    assert report["loop"]["frames_sent"] == 3
    assert {"overruns", "wake_ups", "duration_s", "busy_fraction"} < set(report["loop"])
    assert {answer["name"] for answer in report["host"]["answers"]} == {
        "timer slack",
        "garbage collector",
    }
    assert "steal_fraction" in report["host"]
    assert report["node"] == {"rms_m": None, "counts": {"lost": 2}}
    assert {"version", "python"} < set(report)


def test_nothing_but_the_report_is_left_in_its_directory(options: Options, tmp_path: Path) -> None:
    directory = tmp_path / "reports"
    directory.mkdir()
    run(options("--report", str(directory / "report.json")), Probe())
    assert os.listdir(directory) == ["report.json"]


def test_the_first_line_says_that_the_bus_is_open(options: Options, capsys: Capture) -> None:
    heard = []
    node = Probe(on_tick_do=lambda: heard.append(capsys.readouterr().out))
    run(options(), node)
    assert heard[0].startswith(f"{NAME}: ready on ")
    assert heard[0].count("\n") == 1


def test_the_last_lines_say_what_the_run_was_like(options: Options, capsys: Capture) -> None:
    run(options(), Probe())
    out = capsys.readouterr().out
    assert f"{NAME}: ended by finished after " in out
    assert "lateness p50 " in out


def test_the_bus_is_shut_down_however_the_run_ends(options: Options, channel: str) -> None:
    def fail() -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run(options(), Probe(on_tick_do=fail))
    # Where the bus of the run is gone, a message reaches nobody.
    with can.Bus(interface="virtual", channel=channel) as bus:
        assert len(bus.channel) == 1  # type: ignore[attr-defined]


# Ends of a run


def test_a_run_ends_after_its_duration(options: Options, tmp_path: Path) -> None:
    file = tmp_path / "report.json"
    run(options("--duration", "0.001", "--report", str(file)), Sleeper())
    assert json.loads(file.read_text())["ended_by"] == "duration"


def test_a_duration_counts_from_the_start_on_the_clock() -> None:
    now_ns = 0
    stop = StopRequest(lambda: now_ns)
    assert not stop()
    stop.end_at(5)
    now_ns = 4
    assert not stop()
    now_ns = 5
    assert stop()
    assert stop.reason == "duration"


@pytest.mark.parametrize(("send", "name"), [(interrupt, "SIGINT"), (terminate, "SIGTERM")])
def test_a_signal_ends_a_run_with_its_report(
    options: Options, tmp_path: Path, send: Callable[[], None], name: str
) -> None:
    file = tmp_path / "report.json"
    node = Probe(ticks=10**6, on_tick_do=send)
    assert run(options("--report", str(file)), node) == ExitStatus.OK
    assert json.loads(file.read_text())["ended_by"] == name


def test_a_second_signal_does_not_cost_the_report(options: Options, tmp_path: Path) -> None:
    file = tmp_path / "report.json"
    node = Probe(ticks=10**6, on_tick_do=interrupt, on_report_do=terminate)
    assert run(options("--report", str(file)), node) == ExitStatus.OK
    assert json.loads(file.read_text())["node"]["counts"] == {"lost": 2}


def test_a_signal_right_after_ready_ends_a_run_with_its_report(
    options: Options, tmp_path: Path
) -> None:
    file = tmp_path / "report.json"

    def make_node(_start_ns: int) -> Probe:
        terminate()
        return Sleeper()

    run_node(NAME, options("--report", str(file)), SomeSettings(), make_node)
    assert json.loads(file.read_text())["ended_by"] == "SIGTERM"


def test_signals_mean_what_they_meant_before_when_the_run_is_over(options: Options) -> None:
    before = signal.getsignal(signal.SIGINT)
    run(options(), Probe(ticks=10, on_tick_do=interrupt))
    assert signal.getsignal(signal.SIGINT) is before


def test_a_bus_that_fails_ends_the_run_with_one_line_and_its_report(
    options: Options, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_arguments: object, **_options: object) -> None:
        raise can.CanOperationError("bus-off")

    monkeypatch.setattr(VirtualBus, "send", refuse)
    file = tmp_path / "report.json"
    node = Probe(sends=[Frame(0x100, b"x")])
    assert run(options("--report", str(file)), node) == ExitStatus.BUS
    assert capsys.readouterr().err == f"{NAME}: error: cannot send: bus-off\n"
    assert json.loads(file.read_text())["ended_by"] == "cannot send: bus-off"


def test_a_bus_that_fails_in_receiving_ends_the_run_likewise(
    options: Options, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_arguments: object, **_options: object) -> None:
        raise can.CanOperationError("the adapter is gone")

    monkeypatch.setattr(VirtualBus, "_recv_internal", refuse)
    file = tmp_path / "report.json"
    assert run(options("--report", str(file)), Probe()) == ExitStatus.BUS
    assert json.loads(file.read_text())["ended_by"] == "cannot receive: the adapter is gone"


def test_with_reconnect_a_bus_that_fails_once_does_not_end_the_run(
    options: Options, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("runtime.connection.RETRY_S", 0.001)
    monkeypatch.setattr("runtime.connection.SETTLED_S", 0.0)
    calls = []

    def refuse_once(*_arguments: object, **_options: object) -> tuple[None, bool]:
        calls.append("recv")
        if len(calls) == 1:
            raise can.CanOperationError("the adapter is gone")
        return None, False

    monkeypatch.setattr(VirtualBus, "_recv_internal", refuse_once)
    file = tmp_path / "report.json"
    heard: list[str] = []

    def hear(_name: str, text: str, _stream: object = None) -> None:
        heard.append(text)
        if "is back" in text:
            interrupt()

    monkeypatch.setattr("runtime.program.say", hear)
    assert run(options("--reconnect", "--report", str(file)), Sleeper()) == ExitStatus.OK
    begin = "cannot receive: the adapter is gone; waiting 60 s"
    assert any(text.startswith(begin) for text in heard)
    report = json.loads(file.read_text())
    assert report["ended_by"] == "SIGINT"
    assert (report["connection"]["outages"], report["connection"]["reconnections"]) == (1, 1)


def test_a_bus_that_fails_again_when_it_is_shut_down_is_told_once(
    options: Options, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    shut_down = VirtualBus.shutdown

    def fail(bus: VirtualBus) -> None:
        shut_down(bus)
        raise can.CanOperationError("the adapter is gone")

    monkeypatch.setattr(VirtualBus, "shutdown", fail)
    assert run(options(), Probe()) == ExitStatus.OK
    assert capsys.readouterr().err == ""


class Faulty(Probe):
    """A node that finds a fault in itself."""

    def report(self) -> Mapping[str, Any]:
        return {"failure": "51 of the last 100 ticks overran, allowed are 50 of 100"}


def test_a_node_that_has_found_a_fault_in_itself_ends_with_its_report_and_a_status_of_its_own(
    options: Options, tmp_path: Path, capsys: Capture
) -> None:
    report = tmp_path / "report.json"
    assert run(options("--report", str(report)), Faulty()) == ExitStatus.SAFE_STATE
    told = capsys.readouterr()
    fault = "safe state: 51 of the last 100 ticks overran, allowed are 50 of 100"
    assert told.err == f"{NAME}: error: {fault}\n"
    assert f"ended by {fault}" in told.out
    written = json.loads(report.read_text())
    assert written["ended_by"] == fault
    assert written["node"]["failure"] in fault


def test_a_fault_is_told_also_where_a_signal_comes_before_the_safe_state_is_reached(
    options: Options, tmp_path: Path
) -> None:
    report = tmp_path / "report.json"
    node = Faulty(ticks=1000, on_tick_do=interrupt)
    assert run(options("--report", str(report)), node) == ExitStatus.SAFE_STATE
    assert json.loads(report.read_text())["ended_by"] == "SIGINT"


def test_every_way_to_end_has_a_status_of_its_own() -> None:
    assert ExitStatus.SAFE_STATE.value == 5
    assert len({*ExitStatus}) == len(ExitStatus.__members__)


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
    assert run(options("--report", str(file)), node) == ExitStatus.OK
    loop = json.loads(file.read_text())["loop"]
    assert (loop["frames_sent"], loop["frames_refused"]) == (0, 3)


def test_a_bus_that_cannot_be_opened_is_one_line_and_makes_no_node(
    options: Options, tmp_path: Path, capsys: Capture
) -> None:
    asked = options("--report", str(tmp_path / "report.json"))
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

    asked = options("--report", str(file))
    status = run_node(NAME, asked, SomeSettings(), lambda _: Probe(), conclude)
    assert (status, done) == (ExitStatus.OK, [(True, True)])


# Reports that cannot be written, readers that are gone


@pytest.mark.parametrize("name", ["none/report.json", "."])
def test_a_report_that_cannot_be_written_is_refused_before_the_run(
    options: Options, tmp_path: Path, capsys: Capture, name: str
) -> None:
    with pytest.raises(SystemExit) as caught:
        options("--report", str(tmp_path / name))
    assert caught.value.code == ExitStatus.SETTINGS
    assert str((tmp_path / name).parent) in capsys.readouterr().err


def test_a_file_of_somebody_else_is_refused_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "report.json"
    file.touch()
    monkeypatch.setattr(os, "access", lambda place, _mode: place != file)
    with pytest.raises(argparse.ArgumentTypeError, match=r"report\.json may not be written"):
        output_file(str(file))


def test_a_report_that_cannot_be_written_after_all_is_one_line(
    options: Options, tmp_path: Path, capsys: Capture
) -> None:
    directory = tmp_path / "reports"
    directory.mkdir()
    file = directory / "report.json"
    asked = options("--report", str(file))
    status = run_main(NAME, lambda: run(asked, Probe(ticks=1, on_tick_do=directory.rmdir)))
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{NAME}: error: {directory}")
    assert line.endswith("No such file or directory")
    assert status == ExitStatus.OUTPUT


def printing_program(output: int) -> subprocess.CompletedProcess[str]:
    """A program that prints without ``say`` and leaves the text to be written at its end."""
    code = (
        "import sys; from runtime.program import run_main;"
        "sys.exit(run_main('p', lambda: print('text') or 0))"
    )
    return subprocess.run(
        [sys.executable, "-c", code], stdout=output, stderr=subprocess.PIPE, text=True, check=False
    )


def test_a_reader_that_reads_no_further_is_no_mistake() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "wb") as pipe:
        result = printing_program(pipe.fileno())
    assert (result.stderr, result.returncode) == ("", ExitStatus.OK)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this platform has no /dev/full")
def test_output_that_cannot_be_written_is_one_line() -> None:
    with open("/dev/full", "wb") as full:
        result = printing_program(full.fileno())
    assert result.stderr == "p: error: No space left on device\n"
    assert result.returncode == ExitStatus.OUTPUT


def test_a_reader_that_is_gone_costs_neither_the_run_nor_its_report(
    presets: str, tmp_path: Path
) -> None:
    file = tmp_path / "report.json"
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]);"
        "from tests.test_program import NAME, Probe, SomeSettings;"
        "from runtime.program import make_parser, run_main, run_node;"
        "options = make_parser(NAME, '', sys.argv[2]).parse_args(sys.argv[3:]);"
        "run = lambda: run_node(NAME, options, SomeSettings(), lambda _: Probe());"
        "sys.exit(run_main(NAME, run))"
    )
    reader, writer = os.pipe()
    os.close(reader)
    try:
        result = subprocess.run(
            [
                *(sys.executable, "-c", code, str(tmp_path), presets, *ORDINARY),
                *("-i", "virtual", "-c", "gone", "--report", str(file)),
            ],
            cwd=Path(__file__).resolve().parent.parent,
            stdout=writer,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    finally:
        os.close(writer)
    assert (result.stderr, result.returncode) == ("", ExitStatus.OK)
    assert json.loads(file.read_text())["ended_by"] == "finished"


# The command line


def test_settings_are_layered_as_the_command_line_asks(
    options: Options, presets: str, tmp_path: Path
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('words = "file"\n')
    asked = options(str(file), "--preset", "strong", "--set", "words=option")
    assert load_program_settings(SomeSettings, presets, asked) == SomeSettings(
        gain=2.0, words="option"
    )
    settings = load_program_settings(SomeSettings, presets, asked, ["words=program"])
    assert settings.words == "program"


@pytest.mark.parametrize(
    "arguments",
    [
        ("--duration", "0"),
        ("--duration", "-1"),
        ("--duration", "nan"),
        ("--duration", "inf"),
        ("--duration", "soon"),
        ("--priority", "100"),
        ("--priority", "-1"),
        ("--cpu", "x"),
        ("--spin-us", "-1"),
        ("--spin-us", "10001"),
        ("--spin-us", "0.5"),
        ("--reconnect-limit", "0"),
        ("--dura", "1"),
        ("one.toml", "two.toml"),
    ],
)
def test_a_bad_argument_has_the_status_of_bad_settings(
    options: Options, capsys: Capture, arguments: tuple[str, ...]
) -> None:
    with pytest.raises(SystemExit) as caught:
        options(*arguments)
    assert caught.value.code == ExitStatus.SETTINGS
    assert f"{NAME}: error: " in capsys.readouterr().err


# What a user can cause is one line and a status


@pytest.mark.parametrize(
    ("error", "status", "lines"),
    [
        (SettingsError("a", "b"), ExitStatus.SETTINGS, ["a", "b"]),
        (BusError("no such bus"), ExitStatus.BUS, ["no such bus"]),
        (PermissionError(13, "not yours", "x"), ExitStatus.OUTPUT, ["x: not yours"]),
        (OSError("told in words"), ExitStatus.OUTPUT, ["told in words"]),
        (KeyboardInterrupt(), ExitStatus.INTERRUPTED, ["interrupted"]),
    ],
)
def test_what_a_user_can_cause_is_one_line_each_and_a_status(
    capsys: Capture, error: BaseException, status: int, lines: list[str]
) -> None:
    def fail() -> int:
        raise error

    assert run_main(NAME, fail) == status
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.splitlines() == [f"{NAME}: error: {line}" for line in lines]


@pytest.mark.parametrize("package", ["controller", "plant_emulator"])
def test_ctrl_c_while_the_modules_of_a_program_are_read_is_no_traceback(
    package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Interrupting:
        def find_spec(self, name: str, *_more: object) -> None:
            if name == f"{package}.program":
                raise KeyboardInterrupt

    program = import_module(f"{package}.__main__")
    monkeypatch.delitem(sys.modules, f"{package}.program", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Interrupting(), *sys.meta_path])
    assert program.main([]) == ExitStatus.INTERRUPTED


def test_what_only_a_programmer_can_cause_is_not_hidden() -> None:
    def fail() -> int:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_main(NAME, fail)
