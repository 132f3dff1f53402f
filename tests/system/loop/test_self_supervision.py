"""A node finds faults in itself, and ends safely: too slow, or a motion that is no number."""

import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    Decoded,
    LateralError,
    PlantStatus,
    SafetyState,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
    decode,
    encode,
)
from steer_by_wire.plant_emulator.command_line import program
from steer_by_wire.plant_emulator.node.node import (
    NOT_FINITE_COMMAND,
    NOT_FINITE_VEHICLE,
    REPORTING_NS,
)
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.moving_vehicle import LARGEST
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.settings import SettingsError, load_settings
from steer_by_wire.tools.run import __main__ as closed_loop
from tests.support.frames.made_messages import command_of, error_of
from tests.support.nodes.plant_link import MS_NS, PERIOD_NS, START_NS, Link, link

OVERSTEER = {
    "speed_m_s": 250 / 3.6,
    "virtual_mass_kg": 100_000.0,
    "yaw_inertia_kg_m2": 100.0,
    "front_cornering_stiffness_n_rad": 1e7,
    "rear_cornering_stiffness_n_rad": 1000.0,
}
"""The fastest growth that the settings allow: e-fold in 27 ms."""


def late(tested: Link, samples: int) -> None:
    """Tick so many times, each late by a period of the sensors, unless it has finished."""
    for _ in range(samples):
        if not tested.node.finished:
            tested.tick(tested.node.deadline_ns + PERIOD_NS)


def finish(tested: Link) -> int:
    """Tick on time until the node has finished; returns when that was [ns]."""
    while not tested.node.finished:
        now_ns = tested.node.deadline_ns
        assert now_ns < START_NS + 100_000 * MS_NS
        tested.tick(now_ns)
    return now_ns


def steering(tested: Link, steer_rad: float = 0.1) -> Link:
    """Command an angle for half a second."""
    for step in range(51):
        tested.command(START_NS + step * PERIOD_NS, steer_rad)
    return tested


# Too slow


def test_a_plant_that_does_not_keep_its_rate_steers_straight_says_so_and_ends() -> None:
    tested = steering(link())
    before = len(tested.frames)
    late(tested, 60)
    report = tested.node.report()
    assert report["failure"] == "51 of the last 100 ticks overran, allowed are 50 of 100"
    safe_state = report["safety"]["safe_state"]
    assert safe_state["cause"] == report["failure"]
    assert not tested.node.finished
    end_ns = finish(tested)
    reported = [message.status for _, message in tested.messages(SteeringStatus)]
    first = reported.index(SteeringStatusCode.SAFE_STATE)
    assert set(reported[first:]) == {SteeringStatusCode.SAFE_STATE}
    assert tested.last(PlantStatus).safety is SafetyState.SAFE_STATE
    assert tested.last(SteeringStatus).wheel_angle_rad == 0.0
    # The ramp from 0.1 rad at 0.2 rad/s ends before the reporting does.
    failed_ns = START_NS + round(safe_state["at_s"] * 1e9)
    assert end_ns == failed_ns + REPORTING_NS
    assert len(tested.frames) > before


def test_a_pause_of_a_minute_is_one_overrun_after_which_the_plant_goes_on() -> None:
    """A process that was stopped, or a machine that slept with its clock running."""
    tested = steering(link(duration_s=1e6))
    back_ns = tested.node.deadline_ns + 60_000 * MS_NS
    tested.tick(back_ns)
    for step in range(20):
        tested.command(back_ns + step * PERIOD_NS, 0.0)
    tested.tick_until(back_ns + 20 * PERIOD_NS)
    report = tested.node.report()
    assert report["failure"] == ""
    assert report["skipped_samples"] >= 60 * 100 - 1
    assert report["safety"]["mode"] == "following"


def test_the_end_comes_when_the_wheel_has_been_ramped_to_zero() -> None:
    tested = steering(link(overruns={"overruns_max": 0}), 0.6)
    late(tested, 1)
    failed_s = tested.node.report()["safety"]["safe_state"]["at_s"]
    end_ns = finish(tested)
    assert (end_ns - START_NS) * 1e-9 - failed_s == pytest.approx(3.0, abs=0.011)
    assert tested.last(SteeringStatus).wheel_angle_rad == 0.0


@pytest.mark.parametrize(("stalls", "fails"), [(45, False), (46, True)])
def test_a_starved_plant_ends_in_its_safe_state(stalls: int, fails: bool) -> None:
    tested = steering(link(duration_s=1e6))
    for _ in range(stalls):
        tested.tick(tested.node.deadline_ns + 11 * PERIOD_NS)
        tested.tick_until(tested.node.deadline_ns + 2 * PERIOD_NS)
    assert ("periods were missed" in tested.node.report()["failure"]) is fails


def test_a_starved_controller_stops_steering_for_good_and_says_why() -> None:
    node = ControllerNode(controller_preset("practical_pd_ddob"), 0)
    for cycle in range(100):
        for offset in range(4):
            now_ns = cycle * 150 * MS_NS + offset * PERIOD_NS + MS_NS // 20
            node.on_frame(encode(error_of(0.01), (4 * cycle + offset) % 256), now_ns)
            node.on_tick(now_ns)
    report = node.report()
    assert "periods were missed" in report["failure"]
    # Found within half of the fifteen seconds.
    assert report["mode_s"]["safe_stop"] > 7.0


# No number


def numbers(value: Any) -> list[float]:
    """All numbers in a report."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return [number for item in value for number in numbers(item)]
    return [value] if isinstance(value, int | float) else []


def test_a_vehicle_that_spins_without_bound_ends_safely_before_it_is_no_number() -> None:
    """Oversteering at high speed (1) grows exponentially, until floats overflow."""
    tested = link(vehicle=OVERSTEER, duration_s=1e6)
    tested.command(START_NS, 0.1)
    finish(tested)
    report = tested.node.report()
    assert report["failure"] == NOT_FINITE_VEHICLE
    assert report["safety"]["safe_state"]["cause"] == NOT_FINITE_VEHICLE
    assert all(map(math.isfinite, numbers(report)))
    json.dumps(report, allow_nan=False)
    last = tested.node.samples[-1]
    assert 1e140 < max(abs(last.lateral_error_m), abs(last.yaw_rate_rad_s)) <= LARGEST
    assert report["final_m"] == last.cg_deviation_m
    # The last sample before the fault, and none after it.
    assert 0.0 < report["safety"]["safe_state"]["at_s"] - last.time_s <= 0.0100001
    assert tested.last(SteeringStatus).status is SteeringStatusCode.SAFE_STATE
    assert tested.last(PlantStatus).safety is SafetyState.SAFE_STATE
    for _, frame in tested.frames:
        decoded = decode(frame)
        if isinstance(decoded, Decoded):
            assert all(map(math.isfinite, decoded.message))
        else:
            assert (str(decoded), frame.can_id) == ("not_available", CAN_IDS[LateralError])


def test_the_wheel_is_brought_back_while_the_vehicle_is_no_number() -> None:
    tested = link(vehicle=OVERSTEER, actuator={"lag_s": 0.1}, safety={"hold_ms": 60_000.0})
    tested.command(START_NS, 0.02)
    end_ns = finish(tested)
    wheel = [(now_ns, m.wheel_angle_rad) for now_ns, m in tested.messages(SteeringStatus)]
    at_ns = START_NS + round(tested.node.report()["safety"]["safe_state"]["at_s"] * 1e9)
    before = [rad for now_ns, rad in wheel if at_ns - 100 * MS_NS < now_ns < at_ns]
    assert min(before) > 0.001
    assert wheel[-1][0] == end_ns
    assert abs(wheel[-1][1]) < 1e-4
    assert tested.last(VehicleState).yaw_rate_rad_s != 0.0


def test_a_command_that_is_no_number_never_reaches_the_wheel(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The wire cannot carry one, so it is put behind the decoding."""
    tested = steering(link())
    monkeypatch.setattr(
        "steer_by_wire.dbc.reception.Reception.receive",
        lambda _self, _frame, _now_ns: command_of(math.nan, 51),
    )
    tested.node.on_frame(Frame(CAN_IDS[SteeringCommand], b""), START_NS + 51 * PERIOD_NS)
    finish(tested)
    assert tested.node.report()["failure"] == NOT_FINITE_COMMAND
    assert {status.status for _, status in tested.messages(SteeringStatus)[52:]} == {
        SteeringStatusCode.SAFE_STATE
    }
    assert tested.last(SteeringStatus).wheel_angle_rad == 0.0
    assert all(math.isfinite(sample.wheel_angle_rad) for sample in tested.node.samples)


@pytest.mark.parametrize(
    ("key", "value", "allowed"),
    [
        ("actuator.lag_s", "1e-12", "must be 0 or 1e-06 to 10"),
        ("actuator.lag_s", "1e-310", "must be 0 or 1e-06 to 10"),
        ("disturbance.steps", "[{at_s=1e308,friction=0.5}]", "1000000"),
    ],
)
def test_settings_that_no_motion_can_be_computed_of_are_refused(
    key: str, value: str, allowed: str
) -> None:
    with pytest.raises(SettingsError, match=allowed):
        load_settings(PlantSettings, overrides=[f"{key}={value}"])


# Around the node


def test_the_program_ends_with_a_report_a_line_and_a_status_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An oversteering vehicle runs away by itself, once something has moved it."""
    report = tmp_path / "report.json"
    growing = [f"vehicle.{key}={value}" for key, value in OVERSTEER.items()]
    push = "disturbance.steps=[{at_s=0.01,yaw_moment_n_m=1e6}]"
    overrides = [*growing, push, "start_on_first_command=false"]
    monkeypatch.setattr(
        "steer_by_wire.plant_emulator.vehicle.moving_vehicle.LARGEST", 1e9
    )  # in half a second, not in seven
    options = [text for override in overrides for text in ("--set", override)]
    arguments = ["-i", "virtual", "-c", "self supervision", "--priority", "0", "--no-memory-lock"]
    status = program.main([*options, *arguments, "--json", str(report)])
    assert status == ExitStatus.SAFE_STATE
    reported = capsys.readouterr()
    assert f"steer-by-wire plant: error: safe state: {NOT_FINITE_VEHICLE}\n" in reported.err
    written = json.loads(report.read_text())
    assert written["ended_by"] == f"safe state: {NOT_FINITE_VEHICLE}"
    assert written["node"]["failure"] == NOT_FINITE_VEHICLE


def test_a_run_of_both_nodes_says_so_too(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    growing = [f"--set=plant.vehicle.{key}={value}" for key, value in OVERSTEER.items()]
    push = "--set=plant.disturbance.steps=[{at_s=0.01,yaw_moment_n_m=1e6}]"
    monkeypatch.setattr("steer_by_wire.plant_emulator.vehicle.moving_vehicle.LARGEST", 1e9)
    assert closed_loop.main([*growing, push]) == ExitStatus.SAFE_STATE
    out = capsys.readouterr().out
    assert re.search(
        rf"^verdict +safe state: plant emulator: {NOT_FINITE_VEHICLE}$", out, re.MULTILINE
    )
    assert out.count(NOT_FINITE_VEHICLE) == 1
    assert closed_loop.main(["--duration", "0.1"]) == ExitStatus.OK
    assert "safe state" not in capsys.readouterr().out
