"""The program ``steer-by-wire plant`` as its users meet it: errors, and an end by a signal."""

from pathlib import Path

import can
import pytest

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.plant_emulator.command_line.program import main
from steer_by_wire.runtime.exit_status import ExitStatus
from tests.support.programs.running_program import PATIENCE_S, running

Capture = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--set", "seed=-1"], ["command line: seed = -1"]),
        (["--seed", "-1"], ["command line: seed = -1"]),
        (["--set", "latency.downlink.mean_s=11"], ["latency.downlink.mean_s = 11", "10.0"]),
        (["--set", "latency.uplink.trace_file=none.csv"], ["none.csv: cannot be read"]),
        (["--preset", "paper_nominl"], ["preset 'paper_nominl'", "paper_nominal"]),
        (["none.toml"], ["none.toml: cannot be read"]),
        (["--set", "path_ahead.reach_s=1.5"], ["[path_ahead]: PATH_AHEAD needs CAN FD: add --fd"]),
        (["--set", "path.kind=waypoints", "--set", "path.file=none.csv"], ["none.csv"]),
    ],
)
def test_wrong_settings_are_one_line_and_status_2(
    capsys: Capture, arguments: list[str], parts: list[str]
) -> None:
    assert main(arguments) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert line.startswith("steer-by-wire plant: error: ")
    assert [part for part in parts if part not in line] == []
    assert captured.out == ""


def test_a_signal_ends_a_run_with_its_report_and_its_trace(tmp_path: Path) -> None:
    trace = tmp_path / "trace.csv"
    with launched_broker() as address:
        bus = ["-i", "emulated", "--bus-kwargs", f"address={address}"]
        options = [*bus, "--trace", str(trace)]
        with (
            running("steer_by_wire.plant_emulator", options, tmp_path / "plant.json") as plant,
            running("steer_by_wire.controller", bus, tmp_path / "controller.json"),
        ):
            plant.wait_for("FOLLOWING")
            with can.Bus(interface="emulated", address=address) as listener:
                assert all(listener.recv(PATIENCE_S) for _ in range(20))  # samples among them
            assert plant.interrupt() == ExitStatus.OK
    assert plant.report()["ended_by"] == "SIGINT"
    assert len(trace.read_text("utf-8").splitlines()) == 1 + plant.report()["node"]["samples"] > 1
