"""Latency on the side of the plant node, changed while it runs; and what the seed decides."""

import math

import pytest

from steer_by_wire.dbc.messages import (
    Direction,
    LatencyModel,
    LateralError,
    PlantStatus,
    SteeringStatus,
    VehicleState,
)
from tests.support.frames.made_messages import latency_of
from tests.support.nodes.plant_link import MS_NS, PERIOD_NS, START_NS, link, seen, steered

# Latency on the other side, and changing it


def test_uplink_latency_delays_frames_and_not_the_sensing() -> None:
    plain = steered(40)
    late = steered(40, latency={"uplink": {"mean_s": 0.033}})
    for tested, latency_s in ((plain, 0.0), (late, 0.033)):
        assert tested.node.samples[-1].uplink_latency_s == pytest.approx(latency_s)
    assert seen(late.node.samples) == seen(plain.node.samples)
    for message_type in (LateralError, SteeringStatus, VehicleState):
        sent = late.messages(message_type)
        assert len(sent) > 15
        assert sent == [
            (now_ns + 33 * MS_NS, message)
            for now_ns, message in plain.messages(message_type)[: len(sent)]
        ]
    # The status of the plant itself takes no detour.
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
    tested.configure(START_NS, latency_of(direction, 0.02))
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
    tested.configure(START_NS, latency_of(Direction.UPLINK, 0.05, 0.01, 0.25, model=model))
    tested.tick_until(START_NS + 400 * PERIOD_NS)
    uplink = tested.node.report()["uplink"]
    assert uplink["injected"]["mean_s"] == pytest.approx(0.05, rel=0.05)
    assert (uplink["injected"]["max_s"] > 0.0501) == (model is not LatencyModel.CONSTANT)
    assert uplink["lost"] / uplink["pushed"] == pytest.approx(0.25, abs=0.05)


# Randomness


def test_sensor_noise_is_seeded_and_only_the_sensors_have_it() -> None:
    noise = {"lateral_error_m": 0.01, "yaw_rate_rad_s": 0.02}
    quiet, noisy, again = (steered(300, sensor_noise=given) for given in ({}, noise, noise))
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
