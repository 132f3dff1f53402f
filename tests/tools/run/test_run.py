import json
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import can
import pytest

from steer_by_wire.closed_loop.pair.pair_result import Trace
from steer_by_wire.dbc.messages import CAN_IDS, LateralError, SteeringCommand
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import ERROR, Frame
from steer_by_wire.tools.run import __main__ as closed_loop
from tests.support.frames.recorded_frames import entries_in
from tests.support.programs.running_program import PATIENCE_S

LATENCY = ["--set", "plant.latency.downlink.mean_s=0.08"]


def frames_in(log: Path) -> list[Frame]:
    return [entry.frame for entry in entries_in(log)]


def test_a_run_in_virtual_time_leaves_its_files_and_prints_its_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        closed_loop.main(["--duration", "2", "--seed", "5", "--out", str(tmp_path), *LATENCY]) == 0
    )
    plant = json.loads((tmp_path / "plant_emulator.json").read_text())
    controller = json.loads((tmp_path / "controller.json").read_text())
    assert plant["ended_by"] == controller["ended_by"] == "finished"
    assert plant["settings"]["seed"] == 5
    assert controller["node"]["law"] == "pd_ddob"
    assert len(Trace.read(tmp_path / "plant_trace.csv").time_s) == plant["node"]["samples"] >= 200
    counts = Counter(frame.can_id for frame in frames_in(tmp_path / "candump.log"))
    assert counts[CAN_IDS[SteeringCommand]] == pytest.approx(200, abs=2)
    assert counts[CAN_IDS[LateralError]] == pytest.approx(200, abs=2)
    printed = capsys.readouterr().out
    assert f"{1e3 * plant['node']['preview_rms_m']:.2f} mm" in printed


@pytest.mark.parametrize(
    "wire",
    [["--bitrate", "250000"], ["--ideal-wire"], ["--load", "0.5", "--bit-error-rate", "1e-3"]],
    ids=["bit rate", "ideal", "errors"],
)
def test_the_command_it_prints_makes_the_same_run_again(
    wire: Sequence[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    jitter = [
        *LATENCY,
        *("--set", "plant.latency.downlink.model=gamma"),
        *("--set", "plant.latency.downlink.spread_s=0.03"),
        *("--preset", "practical_pd_cdob"),
        *("--set", "controller.supervision.hold_ms=123"),
    ]
    options = ["--duration", "1.5", "--seed", "9", *jitter, *wire, "--out", str(first)]
    assert closed_loop.main(options) == 0
    *_, again, verdict = capsys.readouterr().out.splitlines()
    assert verdict.startswith("verdict ")
    again = again.removeprefix("again").strip()
    _command, _run, *arguments = shlex.split(again)
    assert closed_loop.main([*arguments, "--out", str(second)]) == 0
    for file in sorted(first.iterdir()):
        assert (second / file.name).read_bytes() == file.read_bytes()


NAMED = {
    "lte.csv": ("latency_s\n0.1\n", "--set=plant.latency.downlink.trace_file={}"),
    "way.csv": ("x_m,y_m\n0,0\n9,0\n99,5\n", '--set=plant.path={{kind="waypoints",file="{}"}}'),
    "own_law.py": (
        "from steer_by_wire.controller.laws import LAWS\nLAW = LAWS['pd']\n",
        "--set=controller.law={.stem}:LAW",
    ),
}
"""By the name of a file: its content, and the option that names it."""


@pytest.mark.parametrize("name", NAMED)
def test_a_run_is_repeated_from_any_folder_or_refused_once_a_named_file_has_changed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text, option = NAMED[name]
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    named = Path(name)
    named.write_text(text, encoding="utf-8")
    arguments = ["--preset=practical_pd", "--duration=1", option.format(named), "--out=first"]
    assert closed_loop.main(arguments) == 0
    other = tmp_path / "other"
    other.mkdir()
    monkeypatch.chdir(other)
    again = [
        str(tmp_path / "first" / "plant_emulator.toml"),
        *("--controller", str(tmp_path / "first" / "controller.toml")),
        *("--bus-settings", str(tmp_path / "first" / "bus.toml")),
    ]
    assert closed_loop.main([*again, "--out=second"]) == 0
    logs = [folder / "candump.log" for folder in (tmp_path / "first", other / "second")]
    assert logs[0].read_bytes() == logs[1].read_bytes()
    (tmp_path / name).write_text(text + "\n", encoding="utf-8")
    capsys.readouterr()
    assert closed_loop.main([*again, "--out=third"]) == ExitStatus.SETTINGS
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{tmp_path / name} has changed since the run" in line


def test_an_interrupt_ends_a_run_with_what_there_is(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "steer_by_wire.tools.run",
        "--duration",
        "1e6",
        "--out",
        str(tmp_path),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        log = tmp_path / "candump.log"
        while process.poll() is None and not (log.exists() and log.stat().st_size):
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        printed, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert "by SIGINT" in printed
    assert re.search(r"\nverdict +stopped after \S+ s of 1e\+06 s; until then ", printed)
    report = json.loads((tmp_path / "plant_emulator.json").read_text())
    assert 0.0 < report["node"]["motion_s"] < 1e6


@pytest.fixture
def noisy_log(tmp_path: Path) -> Path:
    noisy = ["--duration", "0.5", "--bit-error-rate", "3e-3", "--out", str(tmp_path)]
    assert closed_loop.main(noisy) == 0
    return tmp_path / "candump.log"


@pytest.mark.skipif(shutil.which("log2asc") is None, reason="needs can-utils")
def test_log2asc_finds_every_error_frame_of_a_recording(noisy_log: Path) -> None:
    asc = noisy_log.with_suffix(".asc")
    subprocess.run(["log2asc", "-I", noisy_log, "-O", asc, "virtual"], check=True)
    with can.ASCReader(str(asc)) as reader:
        read = [message.is_error_frame for message in reader]
    assert read == [frame.flags == ERROR for frame in frames_in(noisy_log)]


def test_a_condition_that_is_met_ends_with_a_status_of_its_own(
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = ["--duration", "2", "--fail-if"]
    assert closed_loop.main([*run, "rms_m > 0.5"]) == ExitStatus.OK
    met = ["verdict != limit cycle", "--fail-if", "controller_active_share > 0.5"]
    assert closed_loop.main([*run, *met]) == ExitStatus.CONDITION
    first, second = capsys.readouterr().err.splitlines()
    assert first == ("steer-by-wire run: failed: verdict != limit cycle: verdict is holds")
    assert "controller_active_share is " in second


def test_a_folder_keeps_its_run_unless_the_settings_are_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--duration", "1", "--out", str(tmp_path)]
    assert closed_loop.main([*words, "--seed", "3"]) == 0
    trace = (tmp_path / "plant_trace.csv").read_bytes()
    assert closed_loop.main([*words, "--seed", "4"]) == 2
    assert f"--out {tmp_path} has another run, whose plant_emulator.toml differs" in (
        capsys.readouterr().err
    )
    assert (tmp_path / "plant_trace.csv").read_bytes() == trace
    assert closed_loop.main([*words, "--seed", "3"]) == 0


def test_the_figures_of_a_run_are_printed_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert closed_loop.main(["--duration", "1", "--json", "-"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["verdict"].startswith("holds: ")
    assert {"plant_emulator", "controller"} < set(figures)
