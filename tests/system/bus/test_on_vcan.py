"""Both programs on a real vcan0, among the programs of can-utils.

One run, in phases that foreign frames on the bus set apart from each other: every assertion is
about what the log and the reports hold, and none about when.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from steer_by_wire.closed_loop.processes.process_group import Processes
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    CYCLE_TIMES_MS,
    LateralError,
    Mode,
    PlantStatus,
    SteeringCommand,
)
from steer_by_wire.runtime.frame import FD, Frame
from tests.support.frames.decoded_frames import messages_in
from tests.support.frames.recorded_frames import entries_in
from tests.support.programs.running_program import ORDINARY, PATIENCE_S, UNSUPERVISED, wait_until

pytestmark = pytest.mark.vcan

ROOT = Path(__file__).resolve().parents[3]
DBC = ROOT / "dbc" / "steer_by_wire.dbc"
CHANNEL = "vcan0"
LATENCY_CONFIG = "320#2320032C016400"
"""As in the README: 80 ms ± 30 ms, 1 % lost, both directions."""
LATENCY_S = 0.08
MARK_ID = 0x7F0
A_COMMAND = " 100#"
FOREIGN_ID = 0x5A0
FLOOD_FRAMES = 2_000
FD_FRAMES = 100
PHASE_COMMANDS = 40
"""Of a phase in which nothing is done to the pair: three times what is sent most rarely."""
ON_CHANNEL = ["-i", "socketcan", "-c", CHANNEL, *ORDINARY, *UNSUPERVISED]
PLANT_OPTIONS = [
    *ON_CHANNEL, "--preset", "paper_nominal", "--interventions", "--set", "duration_s=600",
    "--set", "path.kind=ellipse", "--set", "path.semi_major_axis_m=20",
    "--set", "path.semi_minor_axis_m=10",
]  # fmt: skip
CONTROLLER_OPTIONS = [
    *ON_CHANNEL, "--preset", "practical_pd", "--set", "supervision.fault_tolerant_time_ms=5000",
    "--set", "pd.derivative_gain_rad_s_m=0",
]  # fmt: skip
"""The machine may stall for longer than a network may, and a hold would fade out for a second.

A command without a derivative follows from one measurement, whichever a stalled controller missed.
"""
LOGGED = f"{CHANNEL},000:400,{MARK_ID:X}:7FF"
"""Without the flood, which would fill the buffer of candump's socket."""
CANDUMP_BUFFER_BYTES = 4_000_000
"""Room for some seconds in which candump does not run."""


Log = list[Frame]
"""Every frame on the bus, in the bus's order."""


class Phases(NamedTuple):
    """The log of a run, cut into its phases."""

    alone: Log
    latency: Log
    foreign_fd: Log
    flood: Log
    after: Log


class Run(NamedTuple):
    phases: Phases
    decoded: list[str]
    plant: dict[str, Any]
    controller: dict[str, Any]


def read(path: Path) -> Log:
    return [entry.frame for entry in entries_in(path)]


@contextmanager
def candump(log: Path) -> Iterator[None]:
    with log.open("wb") as file:
        command = ["candump", "-L", "-r", str(CANDUMP_BUFFER_BYTES), LOGGED]
        with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=file) as process:
            try:
                yield
            finally:
                process.terminate()


def call(*command: str) -> None:
    subprocess.run(command, check=True, timeout=PATIENCE_S, stdin=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("on_vcan")


@pytest.fixture(scope="module")
def run(folder: Path) -> Run:
    """Drive: alone, with latency, among foreign frames of CAN FD, in a flood, and after it."""
    log, decoded = folder / "log", folder / "decoded"

    def await_commands(count: int) -> None:
        wanted = log.read_text(encoding="ascii").count(A_COMMAND) + count
        wait_until(
            lambda: log.read_text(encoding="ascii").count(A_COMMAND) >= wanted, "commands flow"
        )

    def end_phase() -> None:
        call("cansend", CHANNEL, f"{MARK_ID:03X}#")

    options = {"controller": [*CONTROLLER_OPTIONS, "--fd"], "plant_emulator": PLANT_OPTIONS}
    with candump(log):
        with Processes(folder) as pair:
            for name, given in options.items():
                report = str(pair.path(name, ".json"))
                pair.begin(name, f"steer_by_wire.{name}", ["--json", report, *given])
            with decoding(decoded):
                await_commands(2 * PHASE_COMMANDS)
            end_phase()
            call("cansend", CHANNEL, LATENCY_CONFIG)
            await_commands(PHASE_COMMANDS)
            end_phase()
            call("cansend", CHANNEL, f"{CAN_IDS[LateralError]:03X}##0{'00' * 12}")
            call("cangen", CHANNEL, "-f", "-b", "-g", "1", "-I", "r", "-n", str(FD_FRAMES))
            await_commands(PHASE_COMMANDS)
            end_phase()
            flood = ["-g", "0", "-I", f"{FOREIGN_ID:X}", "-L", "8", "-n", str(FLOOD_FRAMES)]
            call("cangen", CHANNEL, *flood)
            end_phase()
            await_commands(PHASE_COMMANDS)
            end_phase()
            assert [pair.status(name) for name in options] == [None, None]
            assert [pair.end(name) for name in options] == [0, 0]
            reports = {name: json.loads(pair.path(name, ".json").read_text()) for name in options}
        wait_until(lambda: len(cut(read(log))) == len(Phases._fields), "the log is complete")
    return Run(
        Phases(*cut(read(log))),
        decoded.read_text(encoding="utf-8").splitlines(),
        reports["plant_emulator"],
        reports["controller"],
    )


@contextmanager
def decoding(output: Path) -> Iterator[None]:
    """Run ``candump vcan0 | cantools decode --single-line`` during the block."""
    cantools = [sys.executable, "-m", "cantools", "decode", "--single-line", str(DBC)]
    with (
        output.open("wb") as file,
        subprocess.Popen(["candump", CHANNEL], stdout=subprocess.PIPE) as dump,
        subprocess.Popen(cantools, stdin=dump.stdout, stdout=file) as decoder,
    ):
        assert dump.stdout is not None
        dump.stdout.close()
        try:
            yield
        finally:
            dump.terminate()
        assert decoder.wait(PATIENCE_S) == 0


def cut(log: Log) -> list[Log]:
    """Cut the log at its marks; what comes after the last belongs to no phase."""
    phases: list[Log] = []
    current: Log = []
    for frame in log:
        if frame.can_id == MARK_ID and not frame.flags & FD:
            phases.append(current)
            current = []
        else:
            current.append(frame)
    return phases


def mostly_active(log: Log) -> bool:
    """Whether the law was in force, but for stalls of the machine, also one at the end."""
    modes = [command.mode for command in messages_in(log, SteeringCommand)]
    return modes.count(Mode.ACTIVE) > 0.5 * len(modes)


def test_the_loop_closes_with_every_message_of_the_contract(run: Run) -> None:
    expected = {kind for kind, cycle_ms in CYCLE_TIMES_MS.items() if cycle_ms}
    assert {kind for kind in expected if messages_in(run.phases.alone, kind)} == expected
    assert mostly_active(run.phases.alone)
    assert run.plant["node"]["motion_s"] > 0


def test_cantools_decodes_every_frame_that_candump_shows(run: Run) -> None:
    frames = [line for line in run.decoded if line.strip()]
    assert len(frames) >= PHASE_COMMANDS
    names = [line.partition("::")[2].partition("(")[0].strip() for line in frames]
    assert set(names) == {
        "STEERING_COMMAND",
        "LATERAL_ERROR",
        "STEERING_STATUS",
        "VEHICLE_STATE",
        "CONTROLLER_STATUS",
        "CONTROLLER_SAFETY",
        "DELAY_STATUS",
        "PLANT_STATUS",
    }


def test_a_latency_sent_by_cansend_is_in_force_in_both_directions(run: Run) -> None:
    before, after = (
        messages_in(log, PlantStatus) for log in (run.phases.alone, run.phases.latency)
    )
    assert {status.downlink_latency_s + status.uplink_latency_s for status in before} == {0.0}
    assert max(status.downlink_latency_s for status in after) > 0.5 * LATENCY_S
    assert max(status.uplink_latency_s for status in after) > 0.5 * LATENCY_S
    for direction in ("downlink", "uplink"):
        assert run.plant["node"][direction]["injected"]["max_s"] > LATENCY_S


def test_foreign_frames_of_can_fd_do_no_harm(run: Run) -> None:
    assert any(frame.flags & FD for frame in run.phases.foreign_fd)
    assert mostly_active(run.phases.foreign_fd)
    # The plant's socket does not see them; the controller's does, and takes none for a message.
    assert run.plant["node"]["rejected"] == {}
    assert sum(run.controller["node"]["rejected"].values()) >= 1


def test_the_pair_survives_a_flood(run: Run) -> None:
    came = messages_in(run.phases.flood, SteeringCommand)
    assert came, "no command came between two frames of the flood"
    assert mostly_active(run.phases.after)
