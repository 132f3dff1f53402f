"""The plant node over a link that the test moves: when things act, and what they depend on."""

import math
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc.messages import (
    CAN_IDS,
    Decoded,
    Direction,
    LatencyConfig,
    LatencyModel,
    LateralError,
    Message,
    Mode,
    PlantStatus,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
    decode,
    encode,
    encode_not_available,
    limits,
)
from plant_emulator.motion import Motion
from plant_emulator.node import PlantNode, motion_params
from plant_emulator.plant_samples import PlantSample
from plant_emulator.settings import PlantSettings
from runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame

MS_NS = 1_000_000
PERIOD_NS = 10 * MS_NS
START_NS = 7_000_003
NORMAL = {"model": "normal", "mean_s": 0.08, "spread_s": 0.03}


def plant_settings(**tables: Any) -> PlantSettings:
    return PlantSettings.model_validate(tables)


class Link:
    """Delivers commands as a controller would and keeps every frame that comes out."""

    def __init__(self, settings: PlantSettings) -> None:
        self.settings = settings
        self.node = PlantNode(settings, START_NS)
        self.frames: list[tuple[int, Frame]] = []
        self.counter = 0

    def tick(self, now_ns: int) -> None:
        self.frames.extend((now_ns, frame) for frame in self.node.on_tick(now_ns))

    def tick_until(self, until_ns: int) -> None:
        """Tick at every deadline up to ``until_ns``, exactly on time."""
        while self.node.deadline_ns <= until_ns:
            self.tick(self.node.deadline_ns)

    def command(self, now_ns: int, steer_rad: float) -> None:
        """Deliver a command at ``now_ns``, after all that is due before."""
        self.tick_until(now_ns - 1)
        message = SteeringCommand(steer_rad, self.counter % 65_536, Mode.ACTIVE)
        assert self.node.on_frame(encode(message, self.counter % 256), now_ns) == ()
        self.counter += 1

    def configure(self, now_ns: int, config: LatencyConfig) -> None:
        self.tick_until(now_ns - 1)
        assert self.node.on_frame(encode(config, 0), now_ns) == ()

    def messages(self, message_type: type[Message]) -> list[tuple[int, Any]]:
        """Times and contents of all messages of one type so far."""
        found = []
        for now_ns, frame in self.frames:
            decoded = decode(frame)
            if isinstance(decoded, Decoded) and isinstance(decoded.message, message_type):
                found.append((now_ns, decoded.message))
        return found

    def last(self, message_type: type[Message]) -> Any:
        return self.messages(message_type)[-1][1]


def link(**tables: Any) -> Link:
    return Link(plant_settings(**tables))


def steered(steps: int, seed: int = 1, late_ns: int = 0, **tables: Any) -> Link:
    """A run with a varying command every period, 4 ms after the sample.

    ``late_ns``  by how much every other tick is late
    """
    tested = link(seed=seed, **tables)
    for step in range(steps):
        sample_ns = START_NS + step * PERIOD_NS
        if step % 2 and late_ns:
            tested.tick_until(sample_ns - 1)
            tested.tick(sample_ns + late_ns)
        tested.command(sample_ns + 4 * MS_NS, 0.1 * math.sin(0.3 * step))
    tested.tick_until(START_NS + steps * PERIOD_NS)
    return tested


def on_the_wire(steer_rad: float) -> float:
    """The angle that a command brings; it has the signal's resolution."""
    decoded = decode(encode(SteeringCommand(steer_rad, 0, Mode.ACTIVE), 0))
    assert isinstance(decoded, Decoded)
    assert isinstance(decoded.message, SteeringCommand)
    return decoded.message.steer_rad


def reference_samples(
    settings: PlantSettings, commands: Sequence[tuple[int, float]], motion_start_ns: int, steps: int
) -> list[tuple[float, float, float]]:
    """y, Δψ and wheel angle at each sample, with commands acting at exactly their times."""
    motion = Motion(motion_params(settings))
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
            found.append((motion.lateral_error_m, motion.heading_error_rad, motion.wheel_rad))
    return found


def seen(samples: Sequence[PlantSample]) -> list[tuple[float, float, float]]:
    return [(s.lateral_error_m, s.heading_error_rad, s.wheel_angle_rad) for s in samples]


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
    good = encode(SteeringCommand(0.1, 0, Mode.ACTIVE), 0)
    tested.node.on_frame(good._replace(data=good.data[:-1] + b"\x55"), START_NS)
    not_available = encode_not_available(SteeringCommand(0.0, 1, Mode.ACTIVE), 1)
    tested.node.on_frame(not_available, START_NS)
    tested.tick_until(START_NS + 5 * PERIOD_NS)
    assert not tested.node.samples
    assert tested.node.report()["rejected"] == {"bad_crc": 1, "not_available": 1}


def test_every_fault_of_a_command_is_counted_by_its_cause() -> None:
    tested = link()

    def send(counter: int, **changes: Any) -> None:
        frame = encode(SteeringCommand(0.1, counter, Mode.ACTIVE), counter % 256)
        tested.node.on_frame(frame._replace(**changes), START_NS)

    send(0)
    send(1, data=encode(LateralError(0.0, 0.0), 1).data)
    send(1, data=bytes(8))
    send(1, data=bytes(3))
    send(1)
    send(1)
    send(4)
    send(2)
    send(120)
    report = tested.node.report()
    assert report["accepted"] == 3
    assert report["lost_on_the_bus"] == 2
    assert report["rejected"] == {
        "bad_crc": 1,
        "masqueraded": 1,
        "out_of_order": 1,
        "repeated": 1,
        "too_far": 1,
        "wrong_length": 1,
    }
    for counter in range(121, 127):
        send(counter)
    assert tested.node.report()["resynchronised"] == 1


def test_with_no_latency_a_command_at_the_instant_of_a_sample_acts_before_the_next() -> None:
    tested = link()
    tested.tick_until(START_NS)
    tested.command(START_NS, 0.1)
    assert tested.node.deadline_ns == START_NS
    tested.tick_until(START_NS + PERIOD_NS)
    assert [sample.wheel_angle_rad for sample in tested.node.samples] == [0.1]
    assert tested.node.samples[0].time_s == 0.01


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


# Latency on the other side, and changing it


def test_uplink_latency_delays_frames_and_not_the_sensing() -> None:
    plain = steered(40)
    late = steered(40, latency={"uplink": {"mean_s": 0.033}})
    assert late.node.samples != plain.node.samples  # the samples say what the uplink did
    assert seen(late.node.samples) == seen(plain.node.samples)
    for message_type in (LateralError, SteeringStatus, VehicleState):
        sent = late.messages(message_type)
        assert len(sent) > 15
        assert sent == [
            (now_ns + 33 * MS_NS, message)
            for now_ns, message in plain.messages(message_type)[: len(sent)]
        ]
    # The status of the rig itself takes no detour.
    assert [at for at, _ in late.messages(PlantStatus)] == [
        at for at, _ in plain.messages(PlantStatus)
    ]


@pytest.mark.parametrize(
    ("direction", "downlink_ms", "uplink_ms"),
    [(Direction.DOWNLINK, 20, 0), (Direction.UPLINK, 0, 20), (Direction.BOTH, 20, 20)],
)
def test_latency_is_changed_at_run_time_in_the_direction_asked_for(
    direction: Direction, downlink_ms: int, uplink_ms: int
) -> None:
    tested = link()
    tested.configure(START_NS, LatencyConfig(direction, LatencyModel.CONSTANT, 0.02, 0.0, 0.0))
    tested.command(START_NS, 0.1)
    tested.tick_until(START_NS + 5 * PERIOD_NS)
    wheels = [sample.wheel_angle_rad for sample in tested.node.samples]
    assert wheels.index(0.1) == downlink_ms // 10
    assert tested.messages(LateralError)[0][0] == START_NS + uplink_ms * MS_NS
    tested.tick_until(START_NS + 10 * PERIOD_NS)
    status = tested.last(PlantStatus)
    assert (status.downlink_latency_s, status.uplink_latency_s) == pytest.approx(
        (1e-3 * downlink_ms, 1e-3 * uplink_ms)
    )
    assert tested.node.report()["uplink"]["injected"]["p50_s"] == pytest.approx(
        1e-3 * uplink_ms, rel=0.01
    )


@pytest.mark.parametrize("model", LatencyModel)
def test_every_model_of_the_wire_can_be_asked_for(model: LatencyModel) -> None:
    tested = link()
    tested.configure(START_NS, LatencyConfig(Direction.UPLINK, model, 0.05, 0.01, 0.25))
    tested.tick_until(START_NS + 400 * PERIOD_NS)
    uplink = tested.node.report()["uplink"]
    assert uplink["injected"]["mean_s"] == pytest.approx(0.05, rel=0.05)
    assert (uplink["injected"]["max_s"] > 0.0501) == (model is not LatencyModel.CONSTANT)
    assert uplink["lost"] / uplink["pushed"] == pytest.approx(0.25, abs=0.05)


# Frames nobody should have sent


@st.composite
def any_frames(draw: st.DrawFn) -> Frame:
    ours = st.sampled_from(sorted(CAN_IDS.values()))
    can_id = draw(st.one_of(ours, st.integers(0, 0x1FFFFFFF)))
    kinds = (0, EXTENDED, REMOTE, ERROR, FD, FD | BITRATE_SWITCH, EXTENDED | FD)
    flags = draw(st.sampled_from(kinds))
    length = st.sampled_from([0, 7, 8]) if draw(st.booleans()) else st.integers(0, 64)
    size = draw(length)
    return Frame(can_id, draw(st.binary(min_size=size, max_size=size)), flags)


@settings(deadline=None, max_examples=60)
@given(st.lists(any_frames(), max_size=20))
def test_no_frame_can_make_the_node_raise(frames: list[Frame]) -> None:
    tested = link(path={"kind": "straight"})
    for number, frame in enumerate(frames):
        now_ns = START_NS + number * MS_NS
        assert tested.node.on_frame(frame, now_ns) == ()
        tested.tick(now_ns)
    assert len(tested.messages(LateralError)) + len(tested.messages(SteeringStatus)) > 0 or not (
        frames
    )


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**64 - 1))
def test_any_content_of_a_latency_configuration_is_taken_or_counted(word: int) -> None:
    """It has no checksum, so anything can arrive."""
    tested = link(start_on_first_command=False)
    data = word.to_bytes(8, "little")[: len(encode(A_CONFIG, 0).data)]
    tested.node.on_frame(Frame(CAN_IDS[LatencyConfig], data), START_NS)
    tested.tick_until(START_NS + 30 * PERIOD_NS)
    report = tested.node.report()
    assert report["accepted"] + sum(report["rejected"].values()) == 1


A_CONFIG = LatencyConfig(Direction.BOTH, LatencyModel.CONSTANT, 0.0, 0.0, 0.0)


def test_bad_frames_are_counted_by_cause_and_change_nothing() -> None:
    def run(with_bad: bool) -> Link:
        tested = link()
        for step in range(30):
            now_ns = START_NS + step * PERIOD_NS
            tested.command(now_ns, 0.01 * step)
            good = encode(SteeringCommand(0.5, 0, Mode.ACTIVE), step)
            if with_bad and step % 3 == 0:
                bad = (
                    good._replace(data=good.data[:-1] + b"\xff"),
                    good._replace(data=good.data[:5]),
                    good._replace(flags=EXTENDED),
                    good,  # the counter of the command before
                    encode(SteeringCommand(0.5, 0, Mode.ACTIVE), (step - 5) % 256),
                    encode(SteeringCommand(0.5, 0, Mode.ACTIVE), (step + 110) % 256),
                    encode_not_available(SteeringCommand(0.5, 0, Mode.ACTIVE), step + 1),
                    encode(LateralError(1.0, 0.0), 0),  # one of the rig's own: not for it
                    Frame(0x7FF, b""),
                )
                for frame in bad:
                    tested.node.on_frame(frame, now_ns)
            tested.tick_until(now_ns)
        return tested

    clean, disturbed = run(False), run(True)
    assert disturbed.node.samples == clean.node.samples
    assert disturbed.node.report()["rejected"] == {
        "bad_crc": 10,
        "wrong_length": 10,
        "wrong_format": 10,
        "repeated": 10,
        "out_of_order": 10,
        "too_far": 10,
        "not_available": 10,
    }
    assert disturbed.node.report()["accepted"] == 30
    assert disturbed.last(PlantStatus).rejected == 49  # at 200 ms, 7 at each of 7 steps
    assert clean.node.report()["rejected"] == {}


def test_commands_that_never_came_are_counted() -> None:
    tested = link()
    tested.command(START_NS, 0.1)
    tested.counter += 4
    tested.command(START_NS + PERIOD_NS, 0.1)
    assert tested.node.report()["lost_on_the_bus"] == 4


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
    """The contract that `controller.link_memory` pairs them by; here the vehicle has left."""
    tested = link(vehicle={"speed_km_h": 150}, start_on_first_command=False, duration_s=60)
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


# Randomness


def a_rough_run(seed: int, **tables: Any) -> Link:
    rough = {**NORMAL, "loss": 0.1, "duplicates": 0.1}
    return steered(80, seed, latency={"downlink": rough, "uplink": rough}, **tables)


def test_the_same_seed_gives_the_same_frames_byte_for_byte() -> None:
    assert a_rough_run(3).frames == a_rough_run(3).frames
    assert a_rough_run(3).node.report() == a_rough_run(3).node.report()
    assert a_rough_run(3).frames != a_rough_run(4).frames


def test_sensor_noise_is_seeded_and_only_the_sensors_have_it() -> None:
    noise = {"lateral_error_m": 0.01, "yaw_rate_rad_s": 0.02}
    quiet, noisy, again = (
        steered(300),
        steered(300, sensor_noise=noise),
        steered(300, sensor_noise=noise),
    )
    assert noisy.frames == again.frames
    assert noisy.node.samples == quiet.node.samples
    for message_type, field, deviation in ((LateralError, 0, 0.01), (VehicleState, 1, 0.02)):
        differences = [
            measured[field] - true[field]
            for (_, measured), (_, true) in zip(
                noisy.messages(message_type), quiet.messages(message_type), strict=True
            )
        ]
        mean_square = sum(d * d for d in differences) / len(differences)
        assert math.sqrt(mean_square) == pytest.approx(deviation, rel=0.2)
    assert [m.heading_error_rad for _, m in noisy.messages(LateralError)] == [
        m.heading_error_rad for _, m in quiet.messages(LateralError)
    ]


# What a signal cannot carry


def test_beyond_its_range_the_lateral_error_is_not_available_and_comes_back() -> None:
    tested = link(vehicle={"speed_km_h": 100}, path={"kind": "circle", "radius_m": 50})
    tested.command(START_NS, 0.0)
    tested.tick_until(START_NS + 1000 * PERIOD_NS)
    largest_m = limits(LateralError)["lateral_error_m"].maximum
    errors = [
        (sample, decode(frame))
        for sample, frame in zip(
            tested.node.samples,
            [f for _, f in tested.frames if f.can_id == CAN_IDS[LateralError]],
            strict=True,
        )
    ]
    beyond = [decoded for s, decoded in errors if abs(s.lateral_error_m) > largest_m]
    within = [decoded for s, decoded in errors if abs(s.lateral_error_m) <= largest_m]
    assert len(beyond) > 100
    assert {str(decoded) for decoded in beyond} == {"not_available"}
    assert all(isinstance(decoded, Decoded) for decoded in within)
    assert tested.node.report()["not_available"] == len(beyond)


def test_the_heading_error_is_an_angle_of_one_turn() -> None:
    tested = link(start_on_first_command=False, safety={"fallback": "keep"})
    tested.command(START_NS, 0.5)
    tested.tick_until(START_NS + 1800 * PERIOD_NS)
    true = [sample.heading_error_rad for sample in tested.node.samples]
    assert max(true) > 3.5
    sent = [message.heading_error_rad for _, message in tested.messages(LateralError)]
    for a, b in zip(true, sent, strict=True):
        assert math.cos(a - b) == pytest.approx(1.0, abs=1e-6)


def test_what_is_sent_as_the_end_of_its_range_is_counted() -> None:
    tested = link(vehicle={"speed_km_h": 250}, path={"kind": "circle", "radius_m": 5})
    tested.command(START_NS, 0.0)
    tested.tick_until(START_NS)
    assert tested.last(VehicleState).preview_curvature_1_m == pytest.approx(0.2)
    assert tested.node.report()["clamped"] == 0
    tested.configure(
        START_NS, LatencyConfig(Direction.DOWNLINK, LatencyModel.CONSTANT, 6.0, 0.0, 0.0)
    )
    tested.command(START_NS + MS_NS, 0.0)
    tested.tick_until(START_NS + 10 * PERIOD_NS)
    largest_s = limits(PlantStatus)["downlink_latency_s"].maximum
    assert tested.last(PlantStatus).downlink_latency_s == pytest.approx(largest_s)
    assert tested.node.report()["clamped"] == 1


def test_samples_are_bounded_and_the_figures_are_not() -> None:
    tested = Link(plant_settings(start_on_first_command=False))
    tested.node = PlantNode(tested.settings, START_NS, samples_max=5)
    tested.tick_until(START_NS + 20 * PERIOD_NS)
    assert len(tested.node.samples) == 5
    assert tested.node.report()["samples"] == 21
    assert tested.node.report()["lateral_error_final_m"] != 0.0
