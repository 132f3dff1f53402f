"""Sampler of the cockpit: signals, place, lights, the list of frames, a replay."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop.recordings.live_reading import TIMED_NS
from steer_by_wire.closed_loop.recordings.live_view import Newest
from steer_by_wire.closed_loop.recordings.log_analysis import analyse_files
from steer_by_wire.closed_loop.recordings.status_lights import Light, lights_of
from steer_by_wire.dbc.messages import (
    CarTruth,
    ControllerFault,
    ControllerSafety,
    ControllerStatus,
    DelayStatus,
    EchoState,
    Freshness,
    GroundTruth,
    LateralError,
    Message,
    Mode,
    PlantStatus,
    SafetyState,
    SteeringStatus,
    SteeringStatusCode,
    encode,
)
from steer_by_wire.plant_emulator.path.ellipse_and_lane_changes import path_of_curvature
from steer_by_wire.plant_emulator.path.path import pose
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.tools.cockpit.sampler import Place, Sampler, message_text, payload_text
from steer_by_wire.tools.cockpit.signals import CHARTS, FIGURES, NAMES
from tests.support.frames.made_messages import command_of, error_of, message_with, motion_of
from tests.support.frames.recorded_frames import entries_in
from tests.support.programs.cockpit_run import NS, PLANT, fed
from tests.support.programs.cockpit_run import log as log

MS = 1_000_000


def signals(sampler: Sampler, now_ns: int) -> dict[str, float]:
    return dict(zip(NAMES, sampler.row(now_ns), strict=True))


# Signals


def test_the_running_figures_are_those_of_the_analysis(log: Path) -> None:
    row = signals(*fed(log))
    wanted = analyse_files([log]).figures["signals"]["cg_deviation_m"]
    assert row["rms_m"] == pytest.approx(wanted["rms"], rel=1e-12)
    assert row["peak_m"] == pytest.approx(abs(wanted["peak"]), rel=1e-12)


def test_figures_that_are_reset_are_those_since_then(log: Path) -> None:
    sampler, now_ns = fed(log)
    sampler.reset_figures()
    assert math.isnan(signals(sampler, now_ns)["rms_m"])
    sampler.on_frame(encode(error_of(-0.25), 0), now_ns)
    row = signals(sampler, now_ns)
    assert row["rms_m"] == row["peak_m"] == -row["cg_deviation_m"] > 0.25


def test_a_command_is_in_effect_one_latency_after_it_was_wanted(log: Path) -> None:
    sampler = Sampler(0)
    wanted: list[tuple[int, float]] = []
    compared = 0
    for entry in entries_in(log):
        sampler.on_frame(entry.frame, entry.time_ns)
        row = signals(sampler, entry.time_ns)
        wanted.append((entry.time_ns, row["steer_rad"]))
        if entry.frame.can_id != 0x120 or entry.time_ns < NS:
            continue
        earlier = [rad for at, rad in wanted if at <= entry.time_ns - 80 * MS]
        # The status is of the sample, a little before its frame is on the bus.
        assert row["steer_in_effect_rad"] in earlier[-12:]
        compared += 1
        if compared == 100:
            break
    assert compared == 100


def test_the_round_trip_has_the_latency_and_the_wait_for_the_sample(log: Path) -> None:
    row = signals(*fed(log))
    assert 0.08 <= row["round_trip_s"] < 0.1
    assert row["downlink_s"] == pytest.approx(0.08, abs=5e-4)
    assert row["uplink_s"] == 0.0


def test_what_is_silent_is_absent(log: Path) -> None:
    sampler, now_ns = fed(log)
    later = signals(sampler, now_ns + NS)
    gone = ("lateral_error_m", "steer_rad", "wheel_angle_rad", "downlink_s", "round_trip_s")
    assert all(math.isnan(later[name]) for name in gone)
    assert {light.state for light in sampler.lights(now_ns + NS)} == {"SILENT", "IN_TIME", "INTACT"}


def test_every_chart_and_figure_shows_a_signal_that_there_is() -> None:
    shown = {name for chart in CHARTS for name in (*chart.signals, chart.of_lanes)}
    assert shown | {figure.signal for figure in FIGURES} <= set(NAMES)


# Place


@pytest.mark.parametrize(("error_m", "curvature_1_m"), [(0.0, 0.0), (2.0, 0.05), (-2.0, 0.05)])
def test_a_car_comes_along_its_path_as_it_heads_and_as_near_as_it_is_to_the_bends_middle(
    error_m: float, curvature_1_m: float
) -> None:
    sampler, heading_rad = Sampler(0), 0.5
    error = message_with(LateralError, lateral_error_m=error_m, heading_error_rad=heading_rad)
    motion = motion_of(10.0, preview_curvature_1_m=curvature_1_m)
    for number in range(101):
        now_ns = number * NS // 100
        for message in (message_with(CarTruth), error, motion, command_of()):
            sampler.on_frame(encode(message, number % 256), now_ns)
    row = signals(sampler, NS)
    way_m = 10.0 * math.cos(heading_rad) / (1.0 - curvature_1_m * error_m)
    turned_rad = curvature_1_m * way_m
    assert row["path_heading_rad"] == pytest.approx(turned_rad, rel=0.02)
    assert row["foot_x_m"] == pytest.approx(way_m * np.sinc(turned_rad / math.pi), rel=0.02)


def test_the_place_is_that_of_the_plant(log: Path) -> None:
    sampler, now_ns = fed(log)
    row = signals(sampler, now_ns)
    wanted = pose(build_path(PLANT.path), 5.0 / 3.6 * now_ns / NS)
    assert (row["foot_x_m"], row["foot_y_m"]) == pytest.approx(wanted[:2], abs=0.05)


def test_without_the_path_the_curvature_gives_its_shape() -> None:
    road = path_of_curvature([(2.0, 0.0), (7.0, 0.05), (12.0, 0.0)])
    place = Place(None)
    curvatures = {0: 0.0}
    place.on_vehicle(motion_of(10.0), 0)
    place.on_command(0)
    for number in range(1, 101):
        s_m = 0.2 * number
        curvatures[number] = max(0.0, 0.05 - abs(s_m - 7.0) * 0.01)
        place.on_vehicle(
            motion_of(10.0, preview_curvature_1_m=curvatures[number]), number * 20 * MS
        )
    got, wanted = place.at(100 * 20 * MS), pose(road, 20.0)
    assert got == pytest.approx(wanted, abs=0.05)


def test_the_vehicle_stands_until_the_first_command_and_where_it_was_seen_last() -> None:
    place = Place(None)
    place.on_vehicle(motion_of(10.0), 0)
    assert place.at(5 * NS).x_m == 0.0
    place.on_command(5 * NS)
    assert place.at(5 * NS + 100 * MS).x_m == pytest.approx(1.0)
    assert place.at(60 * NS).x_m == pytest.approx(5.0)  # half a second and no farther


def test_a_car_far_off_is_lost_until_its_plant_starts_again() -> None:
    sampler = Sampler(0)
    sampler.on_frame(encode(motion_of(5.0), 0), 0)
    for number, (error_m, wanted) in enumerate(((19.9, False), (20.1, True))):
        sampler.on_frame(encode(error_of(error_m), number), 0)
        assert sampler.is_lost is wanted
    # Farther off there is no measurement, and the figures do not stand still at the last one.
    assert math.isfinite(signals(sampler, 0)["peak_m"])
    assert math.isnan(signals(sampler, 2 * NS)["peak_m"])
    assert sampler.is_lost
    sampler.on_plant_start()
    assert not sampler.is_lost
    assert sampler.score() == {}


def test_a_car_that_left_its_lane_without_grip_is_told_so() -> None:
    sampler = Sampler(0)
    for number, (off_m, front) in enumerate(((0.1, 0.5), (0.5, 1.0), (0.9, 1.0))):
        truth = message_with(CarTruth, front_grip_used=front)
        for message in (message_with(GroundTruth, cg_deviation_m=off_m), truth):
            assert not sampler.grip_text(number * NS)
            sampler.on_frame(encode(message, number), number * NS)
    said = "its tyres had used up their grip (front 50 % of the time, first at 1.00 s)"
    assert sampler.grip_text(2 * NS) == f"before the car left its lane at 2.00 s, {said}"


# Lights

STATUS = message_with(ControllerStatus, mode=Mode.ACTIVE)
SAFETY = message_with(
    ControllerSafety,
    lateral_error_freshness=Freshness.FRESH,
    steering_status_freshness=Freshness.FRESH,
    vehicle_state_freshness=Freshness.FRESH,
)
STEERING = message_with(SteeringStatus, applied_counter=1, status=SteeringStatusCode.APPLYING)
OF_PLANT = message_with(PlantStatus)
DELAY = message_with(DelayStatus, echo_delay_s=0.1, echo_state=EchoState.KNOWN)


def lights_with(*changed: Message) -> tuple[Light, ...]:
    """The lights of a calm loop, with other messages in place of its own."""
    calm = (STATUS, SAFETY, STEERING, OF_PLANT, DELAY)
    return lights_of(Newest({type(one): one for one in (*calm, *changed)}), {})


def light_of(changed: Message, name: str) -> Light:
    return next(light for light in lights_with(changed) if light.name == name)


def test_a_calm_loop_has_only_good_lights() -> None:
    assert {light.level for light in lights_with()} == {"good"}


def test_every_state_has_a_light_with_its_cause_in_words() -> None:
    cases: list[tuple[str, Message]] = [
        *(("Controller", STATUS._replace(mode=mode)) for mode in Mode),
        *(("Controller", SAFETY._replace(fault=fault)) for fault in ControllerFault),
        *(("Steering", STEERING._replace(status=code)) for code in SteeringStatusCode),
        *(("Safety", OF_PLANT._replace(safety=state)) for state in SafetyState),
    ]
    causes = {light_of(changed, name).cause for name, changed in cases}
    assert len(causes) == len(cases) - 1  # without a fault the mode is shown, ACTIVE again
    assert light_of(cases[3][1], "Controller").level == "bad"


def test_a_stale_message_is_named() -> None:
    light = light_of(SAFETY._replace(vehicle_state_freshness=Freshness.STALE), "Measurements")
    assert (light.level, light.state) == ("bad", "STALE")
    assert light.cause == "VEHICLE_STATE: older than its age limit"


def test_a_refused_frame_lights_up_for_a_while() -> None:
    sampler = Sampler(0)
    good = encode(error_of(), 0)
    sampler.on_frame(Frame(good.can_id, bytes([good.data[0] ^ 1]) + good.data[1:]), NS)
    assert sampler.lights(NS)[-1].cause == "in the last seconds: bad crc"
    assert sampler.lights(5 * NS)[-1].state == "INTACT"


def test_what_was_read_late_lights_up_for_a_while_and_no_time_is_measured_from_it(
    log: Path,
) -> None:
    """Read within a millisecond, 80 ms were a round trip of 1.1 ms under six green lights."""
    sampler = Sampler(0)
    end_ns = 0
    for entry in entries_in(log):
        behind_ns = max(6 * NS - entry.time_ns, 0)  # 6 s of frames at once
        is_late = behind_ns > TIMED_NS
        end_ns = max(entry.time_ns, 6 * NS)
        if is_late:
            sampler.on_late_read(behind_ns, end_ns)
        sampler.on_frame(entry.frame, end_ns, has_time=not is_late)
        row = signals(sampler, end_ns)
        assert not row["round_trip_s"] < 0.08 - TIMED_NS / NS
        if is_late:
            light = next(one for one in sampler.lights(end_ns) if one.name == "Machine")
            assert (light.level, light.state) == ("bad", "TOO_SLOW")
            assert light.cause.startswith("frames were read up to ")
        if entry.time_ns > 9.5 * NS:
            break
    assert row["round_trip_s"] < 0.1
    assert {light.level for light in sampler.lights(end_ns)} == {"good"}


def test_ticks_that_were_skipped_light_up_for_a_while() -> None:
    sampler = Sampler(0)
    for counter, skipped in enumerate((2, 5, 6, 6)):
        status = STATUS._replace(skipped_ticks=skipped)
        sampler.on_frame(encode(status, counter), NS + counter * 100 * MS)
    machine = next(one for one in sampler.lights(NS + 300 * MS) if one.name == "Machine")
    assert (machine.level, machine.state) == ("notice", "TOO_SLOW")
    assert machine.cause == "4 control ticks were skipped in the last seconds"
    assert next(one for one in sampler.lights(5 * NS) if one.name == "Machine").level == "good"


# Frames


def test_a_frame_is_shown_as_candump_shows_it_and_in_words() -> None:
    message = command_of(-0.01234, 17, Mode.HOLDING)
    assert payload_text(Frame(0x320, bytes.fromhex("2320032C016400"))) == (
        "[7]  23 20 03 2C 01 64 00"
    )
    assert message_text(message) == (
        "STEER -0.01234 rad, COMMAND_COUNTER 17, STEERING_COMMAND_MODE HOLDING"
    )


def test_the_list_of_frames_has_cycle_times_beside_those_of_the_dbc(log: Path) -> None:
    sampler, now_ns = fed(log)
    sampler.on_frame(Frame(0x7A0, b"\x01\x02"), now_ns)
    rows = {row["name"]: row for row in sampler.frames(now_ns)["rows"]}
    command = rows["STEERING_COMMAND"]
    assert command["cycle_s"][0] == pytest.approx(command["period_s"], rel=0.01)
    assert (command["id"], command["missing"], command["stale"]) == ("100", 0, False)
    assert rows["LATENCY_CONFIG"]["period_s"] is None
    assert rows["not in the DBC"]["payload"] == "[2]  01 02"
    json.dumps(sampler.frames(now_ns), allow_nan=False)
