"""Broker, plant emulator and controller as real processes, and the same settings in virtual time.

Results that a stall of the machine can change are compared only if there was none: skipped periods,
lateness, and time that the host gave to others reveal a stall.
"""

from itertools import chain, pairwise
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.pair.live_bus import Bus
from steer_by_wire.closed_loop.pair.pair_result import PairFiles, PairResult
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.dbc.messages import (
    ControllerSafety,
    ControllerStatus,
    Decoded,
    DelayStatus,
    LateralError,
    Message,
    Mode,
    PlantStatus,
    SteeringCommand,
    SteeringStatus,
    VehicleState,
    decode,
)
from steer_by_wire.plant_emulator.network.settings import BothLatencySettings, LatencySettings
from steer_by_wire.plant_emulator.path.settings import EllipseSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from tests.support.frames.recorded_frames import entries_in
from tests.support.programs.driven_pair import BEAR_ALL, CONTROLLER, drive_pair

DURATION_S = 4.0
CONTROL_PERIOD_S = 0.01
DOWNLINK_S, UPLINK_S = 0.08, 0.02
ATTEMPTS = 3
LATENESS_S_MAX = 5e-3

PLANT = PlantSettings(
    duration_s=DURATION_S,
    path=EllipseSettings(semi_major_axis_m=20.0, semi_minor_axis_m=10.0),
    latency=BothLatencySettings(
        downlink=LatencySettings(mean_s=DOWNLINK_S), uplink=LatencySettings(mean_s=UPLINK_S)
    ),
    overruns=BEAR_ALL,
)


def drive(folder: Path) -> PairResult:
    with launched_broker() as address:
        return drive_pair(Bus("emulated", "can0", {"address": address}), folder, PLANT)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("two_processes")


@pytest.fixture(scope="module")
def first_run(folder: Path) -> PairResult:
    return drive(folder / "0")


Recorded = list[tuple[float, Message, int]]
"""Time [s], message and end-to-end counter of every frame that the recorder has received."""


@pytest.fixture(scope="module")
def recorded(folder: Path, first_run: PairResult) -> Recorded:
    heard: Recorded = []
    for time_ns, _channel, frame in entries_in(PairFiles(folder / "0").candump_log):
        decoded = decode(frame)
        assert isinstance(decoded, Decoded)
        heard.append((time_ns * 1e-9, decoded.message, decoded.counter))
    assert first_run.plant["node"]["accepted"] > 0
    return heard


def skipped(run: PairResult) -> tuple[int, int]:
    """Periods of the controller and of the plant that a late machine has left out."""
    return run.controller["node"]["skipped_ticks"], run.plant["node"]["skipped_samples"]


PERIODS_S = {
    **dict.fromkeys((SteeringCommand, LateralError, SteeringStatus), 0.01),
    VehicleState: 0.02,
    **dict.fromkeys((ControllerStatus, ControllerSafety, DelayStatus, PlantStatus), 0.1),
}


def test_every_message_flows_and_its_counters_step_by_one(
    recorded: Recorded, first_run: PairResult
) -> None:
    # On a stalled machine the program may skip periods, and reports how many.
    served_s = DURATION_S - CONTROL_PERIOD_S * sum(skipped(first_run))
    for kind, period_s in PERIODS_S.items():
        counters = [counter for _, message, counter in recorded if isinstance(message, kind)]
        assert len(counters) > max(1, 0.5 * served_s / period_s), kind
        assert all((after - before) % 256 == 1 for before, after in pairwise(counters)), kind
    commands = [message for _, message, _ in recorded if isinstance(message, SteeringCommand)]
    numbers = [command.command_counter for command in commands]
    assert all(after - before == 1 for before, after in pairwise(numbers))
    assert {command.mode for command in commands} <= {Mode.ACTIVE, Mode.HOLDING, Mode.SAFE_STOP}


def test_both_reports_are_complete(first_run: PairResult) -> None:
    for report in (first_run.plant, first_run.controller):
        assert {"program", "ended_by", "bus", "settings", "loop", "node", "host"} <= {*report}
        assert report["loop"]["lateness"]["samples"] > 0
        assert report["node"]["rejected"] == {}
    assert first_run.plant["ended_by"] == "finished"
    assert first_run.controller["ended_by"] == "SIGINT"
    assert first_run.plant["settings"] == PLANT.model_dump(mode="json")
    assert first_run.controller["settings"] == CONTROLLER.model_dump(mode="json")
    assert first_run.plant["node"]["motion_s"] >= DURATION_S
    assert first_run.controller["node"]["round_trip"]["mean_s"] >= DOWNLINK_S + UPLINK_S
    assert len(first_run.trace.time_s) == first_run.plant["node"]["samples"]


def is_on_time(run: PairResult) -> bool:
    lateness_s = max(report["loop"]["lateness"]["max_s"] for report in (run.controller, run.plant))
    return not any(skipped(run)) and lateness_s <= LATENESS_S_MAX


def test_on_time_the_processes_drive_as_the_nodes_do_in_virtual_time(
    folder: Path, first_run: PairResult
) -> None:
    further = (drive(folder / str(attempt)) for attempt in range(1, ATTEMPTS))
    run = next(filter(is_on_time, chain([first_run], further)), None)
    if run is None:
        pytest.skip("the host stalled every run")
    virtual = run_virtual_pair(PLANT, CONTROLLER)
    rms_m = virtual.plant["node"]["preview_rms_m"]
    assert run.plant["node"]["preview_rms_m"] == pytest.approx(rms_m, rel=0.1)
