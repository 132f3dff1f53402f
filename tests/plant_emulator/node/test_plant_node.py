"""When things act in the plant node: commands to the nanosecond, ticks late or left out."""

import math
from collections.abc import Sequence
from typing import Any

import pytest

from steer_by_wire.dbc.messages import (
    CAN_IDS,
    Decoded,
    LateralError,
    PlantStatus,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
    decode,
    encode,
    encode_not_available,
)
from steer_by_wire.plant_emulator.sensors.sampling import VEHICLE_STATE_PERIOD_NS
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.exact_propagation import DELTA, PSI, Y
from steer_by_wire.plant_emulator.vehicle.motion_parameters import motion_params
from steer_by_wire.plant_emulator.vehicle.moving_vehicle import Motion
from tests.support.frames.made_messages import command_of
from tests.support.nodes.plant_link import MS_NS, NORMAL, PERIOD_NS, START_NS, link, seen, steered


def on_the_wire(steer_rad: float) -> float:
    """The angle that a command brings; it has the signal's resolution."""
    decoded = decode(encode(command_of(steer_rad), 0))
    assert isinstance(decoded, Decoded)
    assert isinstance(decoded.message, SteeringCommand)
    return decoded.message.steer_rad


def reference_samples(
    settings: PlantSettings, commands: Sequence[tuple[int, float]], motion_start_ns: int, steps: int
) -> list[tuple[float, float, float]]:
    """y, Δψ and wheel angle at each sample, with commands acting at exactly their times."""
    motion = Motion(
        motion_params(settings.vehicle, settings.actuator, settings.path, settings.disturbance)
    )
    waiting = list(commands)
    found = []
    for step in range(steps):
        sample_ns = START_NS + step * PERIOD_NS
        while waiting and waiting[0][0] <= sample_ns:
            acts_ns, steer_rad = waiting.pop(0)
            motion.advance(acts_ns - motion_start_ns)
            motion.command(steer_rad)
        if sample_ns >= motion_start_ns:
            motion.advance(sample_ns - motion_start_ns)
            found.append((motion.linear[Y], motion.linear[PSI], motion.linear[DELTA]))
    return found


# When a command acts


ACTUATORS: tuple[dict[str, float], ...] = (
    {},
    {"lag_s": 0.05, "rate_limit_rad_s": 0.4, "angle_limit_rad": 0.12, "dead_band_rad": 0.002},
)


@pytest.mark.parametrize("actuator", ACTUATORS, ids=["transparent", "real"])
def test_a_command_acts_at_the_nanosecond_it_is_due(actuator: dict[str, float]) -> None:
    latency_ns = 13_456_789
    tested = link(actuator=actuator, latency={"downlink": {"mean_s": latency_ns * 1e-9}})
    came = [START_NS + 5 * MS_NS + step * 7_654_321 for step in range(40)]
    steer = [0.15 * math.sin(0.4 * step) for step in range(40)]
    for came_ns, steer_rad in zip(came, steer, strict=True):
        tested.command(came_ns, steer_rad)
    tested.tick_until(START_NS + 49 * PERIOD_NS)
    commands = [
        (came_ns + latency_ns, on_the_wire(steer_rad))
        for came_ns, steer_rad in zip(came, steer, strict=True)
    ]
    expected = reference_samples(tested.settings, commands, came[0], 50)
    assert len(expected) == 49
    assert seen(tested.node.samples) == expected


def test_motion_starts_when_the_first_command_arrives_and_not_when_it_acts() -> None:
    tested = link(latency={"downlink": {"mean_s": 0.05}}, path={"kind": "circle", "radius_m": 20})
    tested.tick_until(START_NS + 30 * PERIOD_NS)
    assert not tested.node.samples
    assert {message.lateral_error_m for _, message in tested.messages(LateralError)} == {0.0}
    came_ns = START_NS + 303 * MS_NS
    tested.command(came_ns, 0.1)
    tested.tick_until(START_NS + 50 * PERIOD_NS)
    times_s = [sample.time_s for sample in tested.node.samples]
    assert times_s == pytest.approx([(7 + 10 * step) * 1e-3 for step in range(20)], rel=1e-12)
    wheels = [sample.wheel_angle_rad for sample in tested.node.samples]
    assert wheels == [0.0] * 5 + [0.1] * 15
    assert tested.node.samples[4].lateral_error_m != 0.0


def test_motion_starts_at_once_where_it_is_not_to_wait_for_a_command() -> None:
    tested = link(start_on_first_command=False)
    tested.tick_until(START_NS + 3 * PERIOD_NS)
    assert [sample.time_s for sample in tested.node.samples] == pytest.approx([0, 0.01, 0.02, 0.03])
    assert all(math.isnan(sample.command_rad) for sample in tested.node.samples)


def test_a_bad_command_starts_nothing() -> None:
    tested = link()
    good = encode(command_of(0.1), 0)
    tested.node.on_frame(good._replace(data=good.data[:-1] + b"\x55"), START_NS)
    not_available = encode_not_available(command_of(0.0, 1), 1)
    tested.node.on_frame(not_available, START_NS)
    tested.tick_until(START_NS + 5 * PERIOD_NS)
    assert not tested.node.samples
    assert tested.node.report()["rejected"] == {"bad_crc": 1, "not_available": 1}


def test_the_status_echoes_the_command_in_effect() -> None:
    tested = link(latency={"downlink": {"mean_s": 0.025}})
    tested.tick_until(START_NS)
    assert tested.last(SteeringStatus) == (0.0, 0, SteeringStatusCode.NO_COMMAND)
    tested.counter = 700
    for step in range(4):
        tested.command(START_NS + step * PERIOD_NS + MS_NS, 0.01 * (step + 1))
    tested.tick_until(START_NS + 4 * PERIOD_NS)
    assert tested.last(SteeringStatus) == (0.02, 701, SteeringStatusCode.APPLYING)
    tested.tick_until(START_NS + 9 * PERIOD_NS)
    assert tested.last(SteeringStatus) == (0.04, 703, SteeringStatusCode.APPLYING)


def test_a_limited_actuator_says_so() -> None:
    tested = link(actuator={"angle_limit_rad": 0.1})
    tested.command(START_NS, 0.2)
    tested.tick_until(START_NS)
    assert tested.last(SteeringStatus) == (0.1, 0, SteeringStatusCode.LIMITED)


# Time


def test_a_late_tick_moves_the_vehicle_as_a_punctual_one() -> None:
    """The motion is the same but for rounding: it was looked at in other places."""
    tables: dict[str, Any] = {"latency": {"downlink": NORMAL}, "actuator": ACTUATORS[1]}
    punctual = steered(60, **tables)
    late = steered(60, late_ns=3_999_999, **tables)
    assert [at for at, _ in late.messages(LateralError)] != [
        at for at, _ in punctual.messages(LateralError)
    ]
    assert seen(late.node.samples) == seen(punctual.node.samples)
    assert late.node.report()["skipped_samples"] == 0


def test_a_tick_that_misses_samples_skips_them_and_not_the_motion() -> None:
    tables: dict[str, Any] = {"latency": {"downlink": {"mean_s": 0.0123}}}
    punctual, stalled = link(**tables), link(**tables)
    for tested in (punctual, stalled):
        for step in range(4):
            tested.command(START_NS + step * PERIOD_NS, 0.1 * step)
    punctual.tick_until(START_NS + 20 * PERIOD_NS)
    stalled.tick(START_NS + 10 * PERIOD_NS + 1)
    stalled.tick_until(START_NS + 20 * PERIOD_NS)
    assert stalled.node.report()["skipped_samples"] == 7
    by_time = {sample.time_s: sample for sample in punctual.node.samples}
    assert len(stalled.node.samples) == len(by_time) - 7
    for sample in stalled.node.samples:
        # Other steps of the exact propagation round differently.
        assert sample[:7] == pytest.approx(
            by_time[sample.time_s][:7], rel=1e-9, abs=1e-14, nan_ok=True
        )


def test_vehicle_state_keeps_its_rate_and_phase_whichever_samples_are_skipped() -> None:
    """Its share of the samples served was none, where only those between its own are."""
    tested = link(path={"kind": "straight"})
    for step in range(100):
        tested.tick(START_NS + step * VEHICLE_STATE_PERIOD_NS)
    assert tested.node.report()["skipped_samples"] == 99
    assert len(tested.messages(LateralError)) == 100
    assert len(tested.messages(VehicleState)) == 99  # the second sample was that of 10 ms
    punctual_ns = tested.node.deadline_ns
    tested.tick_until(punctual_ns + 6 * PERIOD_NS)
    states_ns = [at for at, _ in tested.messages(VehicleState) if at >= punctual_ns]
    assert [(at - START_NS) % VEHICLE_STATE_PERIOD_NS for at in states_ns] == [PERIOD_NS, 0, 0, 0]


def test_the_deadline_is_always_that_of_the_next_thing_due() -> None:
    tested = link(latency={"downlink": {"mean_s": 0.0031}, "uplink": {"mean_s": 0.0045}})
    assert tested.node.deadline_ns == START_NS
    tested.tick(START_NS)
    assert tested.node.deadline_ns == START_NS + 4_500_000
    tested.command(START_NS + MS_NS, 0.1)
    assert tested.node.deadline_ns == START_NS + 4_100_000
    assert tested.node.on_tick(START_NS + 4_099_999) == []
    tested.tick(START_NS + 4_100_000)
    assert tested.node.deadline_ns == START_NS + 4_500_000
    tested.tick(START_NS + 4_500_000)
    assert tested.node.deadline_ns == START_NS + PERIOD_NS


def test_every_message_keeps_its_cycle_and_counts_its_frames() -> None:
    tested = steered(51)
    for message_type, period_ms, first in (
        (LateralError, 10, 51),
        (SteeringStatus, 10, 51),
        (VehicleState, 20, 26),
        (PlantStatus, 100, 6),
    ):
        times = [at for at, _ in tested.messages(message_type)]
        assert times[:first] == [START_NS + n * period_ms * MS_NS for n in range(first)]
        counters = [f.data[2] for _, f in tested.frames if f.can_id == CAN_IDS[message_type]]
        assert counters == [number % 256 for number in range(len(counters))]


def test_echo_and_measurement_of_one_sample_share_their_counter_even_with_nothing_to_measure() -> (
    None
):
    """The contract that `controller.history.history` pairs them by; here the vehicle has left."""
    tested = link(vehicle={"speed_m_s": 150 / 3.6}, start_on_first_command=False, duration_s=60)
    tested.command(START_NS + PERIOD_NS, 0.5)
    tested.tick_until(START_NS + 1200 * PERIOD_NS)
    pairs: dict[int, set[int]] = {}
    for now_ns, frame in tested.frames:
        if frame.can_id in (CAN_IDS[LateralError], CAN_IDS[SteeringStatus]):
            pairs.setdefault(now_ns, set()).add(frame.data[2])
    assert len(tested.messages(LateralError)) < len(pairs) == 1201
    assert [*pairs.values()] == [{number % 256} for number in range(1201)]


def test_counters_wrap() -> None:
    tested = link()
    tested.tick_until(START_NS + 300 * PERIOD_NS)
    counters = [f.data[2] for _, f in tested.frames if f.can_id == CAN_IDS[LateralError]]
    assert counters == [number % 256 for number in range(301)]


@pytest.mark.parametrize(("period_ms", "per_state"), [(5.0, 4), (10.0, 2), (50.0, 1)])
def test_the_sensor_period_is_a_setting(period_ms: float, per_state: int) -> None:
    tested = link(sensor_period_ms=period_ms)
    tested.tick_until(START_NS + MS_NS * 400 - 1)
    samples = round(400 / period_ms)
    assert len(tested.messages(LateralError)) == samples
    assert len(tested.messages(VehicleState)) == samples // per_state


def test_the_run_is_finished_with_the_sample_at_its_end() -> None:
    tested = link(duration_s=0.1)
    tested.command(START_NS, 0.0)
    tested.tick_until(START_NS + 10 * PERIOD_NS - 1)
    finished_before = tested.node.finished
    tested.tick_until(START_NS + 10 * PERIOD_NS)
    assert (finished_before, tested.node.finished) == (False, True)
    assert tested.node.samples[-1].time_s == 0.1
    assert tested.node.report()["motion_s"] == pytest.approx(0.1)
