"""The program ``steer-by-wire plant`` as its users meet it: errors, a run, its report and trace."""

import csv
import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can
import pytest

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.dbc.edge import UNAUTHENTICATED
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    Decoded,
    LateralError,
    SteeringStatus,
    decode,
    encode,
)
from steer_by_wire.plant_emulator.command_line.program import main
from steer_by_wire.plant_emulator.evaluation.run_record import PlacedSample, PlantSample
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import Frame
from tests.support.frames.made_messages import command_of
from tests.support.programs.running_program import ORDINARY, PATIENCE_S, UNSUPERVISED

Capture = pytest.CaptureFixture[str]
NOTICE = f"steer-by-wire plant: {UNAUTHENTICATED}\n"
"""What every run on classic CAN prints on standard error, once."""


def on_bus(address: str) -> list[str]:
    return ["-i", "emulated", "--bus-kwargs", f"address={address}"]


@contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run the program until the end of the block at the latest; begins when it is ready."""
    program = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "steer_by_wire.plant_emulator",
            *ORDINARY,
            *UNSUPERVISED,
            *arguments,
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with program:
        try:
            assert program.stdout is not None
            assert "ready on" in program.stdout.readline()
            yield program
        finally:
            program.kill()


def drive_until(client: can.BusABC, samples: int) -> list[Frame]:
    """Answer every measurement with a command, as a controller would; returns what came.

    Ends when so many have come, and one of them since a command took effect.
    """
    received: list[Frame] = []
    counter = 0
    while counter < samples or not any(map(is_followed, received)):
        message = client.recv(PATIENCE_S)
        assert message is not None, "the plant has fallen silent"
        received.append(Frame(message.arbitration_id, bytes(message.data)))
        if message.arbitration_id == CAN_IDS[LateralError]:
            command = encode(command_of(0.05, counter), counter % 256)
            client.send(
                can.Message(arbitration_id=command.can_id, data=command.data, is_extended_id=False)
            )
            counter += 1
    return received


def is_followed(frame: Frame) -> bool:
    """Whether the plant has applied a command behind the first."""
    found = decode(frame)
    return (
        isinstance(found, Decoded)
        and isinstance(found.message, SteeringStatus)
        and found.message.applied_counter > 0
    )


# Errors


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--set", "seed=-1"], ["command line: seed = -1"]),
        (["--seed", "-1"], ["command line: seed = -1"]),
        (["--set", "latency.downlink.mean_s=11"], ["latency.downlink.mean_s = 11", "10.0"]),
        (["--set", "latency.uplink.trace_file=none.csv"], ["none.csv: cannot be read"]),
        (["--preset", "paper_nominl"], ["preset paper_nominl", "paper_nominal"]),
        (["none.toml"], ["none.toml: cannot be read"]),
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


# Runs


def checked_report(file: Path) -> Any:
    report = json.loads(file.read_text(encoding="utf-8"))
    assert report["program"] == "steer-by-wire plant"
    assert report["node"]["seed"] == report["settings"]["seed"]
    assert set(report["node"]["downlink"]) >= {"pushed", "released", "lost", "latency", "injected"}
    return report


def test_a_run_ends_by_itself_with_report_and_trace(tmp_path: Path) -> None:
    report_file, trace_file = tmp_path / "report.json", tmp_path / "trace.csv"
    with (
        launched_broker() as address,
        can.Bus(interface="emulated", address=address, ignore_config=True) as client,
        started(
            *on_bus(address),
            "--quiet",
            *("--preset", "paper_nominal", "--seed", "7"),
            *("--set", "duration_s=1.5", "--set", "latency.downlink.mean_s=0.03"),
            *("--json", str(report_file), "--trace", str(trace_file)),
        ) as program,
    ):
        received = drive_until(client, 15)
        out, err = program.communicate(timeout=PATIENCE_S)
        assert (program.returncode, err) == (ExitStatus.OK, NOTICE)
    assert "ended by finished" in out
    assert "car off the path RMS" in out

    report = checked_report(report_file)
    assert report["ended_by"] == "finished"
    assert report["node"]["seed"] == 7
    assert report["node"]["motion_s"] >= 1.5
    # The test has stopped driving; what arrived was taken, and waited for its latency.
    assert report["node"]["accepted"] >= 10
    assert report["node"]["rejected"] == {}
    assert report["node"]["downlink"]["latency"]["p50_s"] == pytest.approx(0.03, rel=0.01)

    with trace_file.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [*PlantSample._fields, *PlacedSample._fields]
    assert len(rows) == report["node"]["samples"]
    times_s = [float(row["time_s"]) for row in rows]
    assert times_s == sorted(times_s)
    assert float(rows[-1]["command_rad"]) == pytest.approx(0.05)

    assert all(isinstance(decode(frame), Decoded) for frame in received)
    assert any(map(is_followed, received))


def test_a_signal_ends_a_run_with_its_report_and_its_trace(tmp_path: Path) -> None:
    report_file, trace_file = tmp_path / "report.json", tmp_path / "trace.csv"
    files = ("--json", str(report_file), "--trace", str(trace_file))
    with (
        launched_broker() as address,
        can.Bus(interface="emulated", address=address, ignore_config=True) as client,
        started(*on_bus(address), "--quiet", *files) as program,
    ):
        drive_until(client, 3)
        program.send_signal(signal.SIGINT)
        _, err = program.communicate(timeout=PATIENCE_S)
        assert (program.returncode, err) == (ExitStatus.OK, NOTICE)
    assert checked_report(report_file)["ended_by"] == "SIGINT"
    assert len(trace_file.read_text().splitlines()) > 1
