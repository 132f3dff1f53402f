"""Common parts of the two programs: a run and its report, the command line, and mistakes."""

import argparse
import json
import os
import subprocess
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import can
import pytest

from steer_by_wire.runtime import command_line
from steer_by_wire.runtime.command_line import output_file, run_main, say
from steer_by_wire.runtime.exit_status import BusError, ExitStatus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.port.port import VIRTUAL_HINT
from steer_by_wire.runtime.program.node_options import load_program_settings
from steer_by_wire.runtime.settings import SettingsError
from tests.support.programs.some_program import NAME, Options, Probe, SomeSettings, run
from tests.support.programs.some_program import channel as channel
from tests.support.programs.some_program import options as options
from tests.support.programs.some_program import presets as presets
from tests.support.programs.some_program import restored_signals as restored_signals

Capture = pytest.CaptureFixture[str]


# A run and its report


def test_a_run_leaves_a_report_of_settings_loop_host_and_node(
    options: Options, tmp_path: Path
) -> None:
    file = tmp_path / "report.json"
    node = Probe(ticks=3, sends=[Frame(0x100, b"x")])
    assert run(options("--json", str(file)), node) == ExitStatus.OK
    report = json.loads(file.read_text())
    assert report["program"] == NAME
    assert report["ended_by"] == "finished"
    assert report["bus"].endswith("(from the command line)")
    assert report["settings"] == {"gain": 1.0, "words": ""}
    assert report["loop"]["lateness"]["samples"] == 3
    assert report["loop"]["frames_sent"] == 3
    assert {"overdue", "wake_ups", "duration_s", "busy_fraction"} < set(report["loop"])
    assert {answer["name"] for answer in report["host"]["answers"]} == {
        "timer slack",
        "garbage collector",
    }
    assert report["node"] == {"rms_m": None, "counts": {"lost": 2}}
    assert {"version", "python"} < set(report)


def test_the_first_line_says_that_the_bus_is_open(options: Options, capsys: Capture) -> None:
    heard = []
    node = Probe(on_tick_do=lambda: heard.append(capsys.readouterr().out))
    run(options(), node)
    assert heard[0].startswith(f"{NAME}: ready on ")
    assert heard[0].splitlines()[1:] == [f"{NAME}: {VIRTUAL_HINT}"]


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
        assert len(bus.channel) == 1


# Reports that cannot be written, readers that are gone


@pytest.mark.parametrize("name", ["none/report.json", "."])
def test_a_report_that_cannot_be_written_is_refused_before_the_run(
    options: Options, tmp_path: Path, capsys: Capture, name: str
) -> None:
    with pytest.raises(SystemExit) as caught:
        options("--json", str(tmp_path / name))
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
    asked = options("--json", str(file))
    status = run_main(NAME, lambda: run(asked, Probe(ticks=1, on_tick_do=directory.rmdir)))
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{NAME}: error: {directory}")
    assert line.endswith("No such file or directory")
    assert status == ExitStatus.OUTPUT


def printing_program(output: int, to_print: str = "print") -> subprocess.CompletedProcess[str]:
    """A program that prints without ``say`` and leaves the text to be written at its end."""
    code = (
        "import sys, rich; from steer_by_wire.runtime.command_line import run_main;"
        f"sys.exit(run_main('p', lambda: {to_print}('text') or 0))"
    )
    return subprocess.run(
        [sys.executable, "-c", code], stdout=output, stderr=subprocess.PIPE, text=True, check=False
    )


@pytest.mark.parametrize("to_print", ["print", "rich.print"])
def test_a_reader_that_reads_no_further_is_no_mistake(to_print: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "wb") as pipe:
        result = printing_program(pipe.fileno(), to_print)
    assert (result.stderr, result.returncode) == ("", ExitStatus.OK)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this platform has no /dev/full")
def test_output_that_cannot_be_written_is_one_line() -> None:
    with open("/dev/full", "wb") as full:
        result = printing_program(full.fileno())
    assert result.stderr == "p: error: No space left on device\n"
    assert result.returncode == ExitStatus.OUTPUT


@pytest.mark.skipif(os.name != "posix", reason="pipes of other platforms cannot be asked")
def test_a_pipe_that_nobody_reads_does_not_keep_a_program_from_its_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(command_line, "BLOCKED_S", 0.01)
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writer, bytes(4096))
    os.set_blocking(writer, True)
    with open(reader, "rb"), open(writer, "w", encoding="utf-8") as full:
        for _ in range(2):
            say("p", "error: the last word", full)
        assert os.fstat(full.fileno()).st_rdev == os.stat(os.devnull).st_rdev


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


def test_a_number_with_a_unit_is_answered_by_the_number(options: Options, capsys: Capture) -> None:
    with pytest.raises(SystemExit):
        options("--duration", "80ms")
    assert "not '80ms' (did you mean 0.08?)" in capsys.readouterr().err


# What a user can cause is one line and a status


@pytest.mark.parametrize(
    ("error", "status", "lines"),
    [
        (SettingsError("a", "b"), ExitStatus.SETTINGS, ["a", "b"]),
        (BusError("no such bus"), ExitStatus.BUS, ["no such bus"]),
        (can.CanOperationError("no such bus"), ExitStatus.BUS, ["no such bus"]),
        (PermissionError(13, "not yours", "x"), ExitStatus.OUTPUT, ["x: not yours"]),
        (OSError("reported in words"), ExitStatus.OUTPUT, ["reported in words"]),
        (RuntimeError("can't start new thread"), ExitStatus.SETTINGS, ["can't start new thread"]),
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
            if name == f"steer_by_wire.{package}.command_line.program":
                raise KeyboardInterrupt

    program = import_module(f"steer_by_wire.{package}.__main__")
    monkeypatch.delitem(sys.modules, f"steer_by_wire.{package}.command_line.program", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Interrupting(), *sys.meta_path])
    assert program.main([]) == ExitStatus.INTERRUPTED


def test_what_only_a_programmer_can_cause_is_not_hidden() -> None:
    def fail() -> int:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_main(NAME, fail)
