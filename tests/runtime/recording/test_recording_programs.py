"""``--record`` as users meet it: mistakes, the report, failures, Ctrl-C of both programs."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.plant_emulator.command_line import program as plant_program
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.recording.recorder import SUFFIXES, recording_obstacle
from steer_by_wire.with_vcan.guard import descendants
from tests.support.frames.recorded_frames import messages_in
from tests.support.programs.running_program import ORDINARY, PATIENCE_S, wait_until

Capture = pytest.CaptureFixture[str]


# What a user may get wrong


def test_names_that_are_no_recordings_are_refused() -> None:
    for suffix in SUFFIXES:
        assert recording_obstacle(Path(f"run{suffix.upper()}")) == ""
    assert "run.db: records as .log, .asc" in recording_obstacle(Path("run.db"))
    assert "run.txt: records as .log, .asc" in recording_obstacle(Path("run.txt"))


@pytest.mark.parametrize("name", ["run.txt", "run", "nowhere/run.log"])
def test_a_bad_name_ends_a_program_with_one_clear_line_and_status_2(
    tmp_path: Path, capsys: Capture, name: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        plant_program.main(["--record", str(tmp_path / name)])
    assert ended.value.code == ExitStatus.SETTINGS
    assert "argument --record: " in capsys.readouterr().err.splitlines()[-1]


@pytest.fixture
def run_plant(
    tmp_path: Path, request: pytest.FixtureRequest
) -> Callable[..., tuple[int, dict[str, Any]]]:
    def run(*options: str) -> tuple[int, dict[str, Any]]:
        report = tmp_path / "report.json"
        bus = ["-i", "virtual", "-c", request.node.name, "--duration", "0.3", *ORDINARY]
        status = plant_program.main([*bus, "--json", str(report), *options])
        return status, json.loads(report.read_text())

    return run


def test_a_report_says_what_was_recorded(
    run_plant: Callable[..., tuple[int, dict[str, Any]]], tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / "run.blf"
    status, report = run_plant("--record", str(path))
    assert status == ExitStatus.OK
    sent = report["loop"]["frames_sent"]
    assert report["recording"] == {
        "file": str(path), "frames": sent, "dropped": 0, "failure": ""
    }  # fmt: skip
    assert len(messages_in(path)) == sent
    assert f"{sent} frames recorded in {path}" in capsys.readouterr().out


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_recording_that_fails_leaves_the_report_and_status_4(
    run_plant: Callable[..., tuple[int, dict[str, Any]]], tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / "run.log"
    path.symlink_to("/dev/full")
    status, report = run_plant("--record", str(path))
    assert status == ExitStatus.OUTPUT
    assert report["recording"]["failure"] == "No space left on device"
    sent, captured = report["loop"]["frames_sent"], capsys.readouterr()
    assert f"up to {sent} frames not recorded: the recording has failed" in captured.out
    assert f"error: {path}: No space left on device" in captured.err


@pytest.mark.skipif(sys.platform != "linux", reason="finds the recorder in /proc")
def test_ctrl_c_ends_a_program_that_waits_for_its_recording(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    os.mkfifo(path)  # opening it waits for somebody who reads
    options = ["-i", "virtual", "-c", "0", "--record", str(path)]
    # A shell has programs in the background ignore Ctrl-C, and they would inherit that.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with subprocess.Popen(
        [sys.executable, "-m", "steer_by_wire.controller", *options],
        stderr=subprocess.PIPE,
        text=True,
    ) as program:
        try:
            signal.signal(signal.SIGINT, before)
            wait_until(lambda: any(map(is_recording, descendants(program.pid))), "a recorder")
            (recorder,) = descendants(program.pid)
            program.send_signal(signal.SIGINT)
            _, said = program.communicate(timeout=PATIENCE_S)
        finally:
            program.kill()
    assert program.returncode == ExitStatus.INTERRUPTED
    assert said.splitlines()[-1] == "steer-by-wire controller: error: interrupted"
    assert not Path(f"/proc/{recorder}").exists()


def is_recording(pid: int) -> bool:
    """Whether a recorder has come to where it ignores SIGINT, just before it opens the file."""
    with suppress(OSError):
        status = Path(f"/proc/{pid}/status").read_text()
        ignored = int(status.partition("SigIgn:")[2].split()[0], 16)
        return bool(ignored & 1 << signal.SIGINT - 1)
    return False
