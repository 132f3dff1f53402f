"""Disturbances set over the bus: the same motion as by a step of the settings."""

from typing import Any

import pytest

from steer_by_wire.dbc.messages import CAN_IDS, DisturbanceConfig
from steer_by_wire.runtime.frame import Frame
from tests.support.frames.made_messages import message_with
from tests.support.nodes.plant_link import MS_NS, START_NS, Link, plant_settings

AT_S = 0.5
END_NS = START_NS + 2000 * MS_NS


def driven(step: dict[str, Any] | None, config: DisturbanceConfig | None, **tables: Any) -> Link:
    """Drive straight on, disturbed by a step of the settings or by a message at that time."""
    steps = [] if step is None else [{"at_s": AT_S, **step}]
    link = Link(
        plant_settings(
            path={"kind": "straight"},
            start_on_first_command=False,
            disturbance={"side_force_arm_m": 0.2, "steps": steps},
            **tables,
        )
    )
    if config is not None:
        link.configure(START_NS + round(1e3 * AT_S) * MS_NS, config)
    link.tick_until(END_NS)
    return link


def places(link: Link) -> list[tuple[float, ...]]:
    return [
        (sample.time_s, sample.lateral_error_m, sample.yaw_rate_rad_s)
        for sample in link.node.samples
    ]


@pytest.mark.parametrize(
    ("step", "config"),
    [
        ({"side_force_n": 1500.0}, message_with(DisturbanceConfig, side_force_n=1500.0)),
        ({"yaw_moment_n_m": -200.0}, message_with(DisturbanceConfig, yaw_moment_n_m=-200.0)),
        (
            {"steering_offset_rad": 0.02, "friction": 0.3},
            message_with(DisturbanceConfig, steering_offset_rad=0.02, friction_loss=0.7),
        ),
    ],
)
def test_a_message_moves_the_vehicle_as_a_step_of_the_settings_does(
    step: dict[str, Any], config: DisturbanceConfig
) -> None:
    by_message = places(driven(None, config))
    assert by_message == places(driven(step, None))
    assert by_message[-1][1] != 0.0


def test_a_message_takes_the_place_of_the_steps_that_are_to_come() -> None:
    calm = driven({"side_force_n": 1500.0}, message_with(DisturbanceConfig))
    assert {error for _, error, _ in places(calm)} == {0.0}


def test_a_message_acts_between_two_samples_at_its_own_time() -> None:
    link = driven(None, None)
    moved = driven(None, None)
    at_ns = END_NS + 3 * MS_NS
    moved.configure(at_ns, message_with(DisturbanceConfig, side_force_n=5000.0))
    for one in (link, moved):
        one.tick_until(END_NS + 9 * MS_NS)
        assert one.node.report()["skipped_samples"] == 0
    assert places(link) == places(moved)
    for one in (link, moved):
        one.tick_until(END_NS + 10 * MS_NS)
    assert places(link)[-1] != places(moved)[-1]


def test_frictions_one_after_the_other_move_the_vehicle_as_steps_do() -> None:
    frictions = (0.5, 0.3, 1.0, 0.5)
    steps = [
        {"at_s": 0.2 * number, "friction": friction, "side_force_n": 900.0}
        for number, friction in enumerate(frictions, start=1)
    ]
    by_settings = Link(
        plant_settings(
            path={"kind": "straight"}, start_on_first_command=False, disturbance={"steps": steps}
        )
    )
    by_settings.tick_until(END_NS)
    by_message = Link(plant_settings(path={"kind": "straight"}, start_on_first_command=False))
    for number, friction in enumerate(frictions, start=1):
        config = message_with(DisturbanceConfig, side_force_n=900.0, friction_loss=1.0 - friction)
        by_message.configure(START_NS + 200 * MS_NS * number, config)
    by_message.tick_until(END_NS)
    assert places(by_message) == places(by_settings)


def test_a_damaged_message_is_refused_and_counted() -> None:
    link = driven(None, None)
    frame = Frame(CAN_IDS[DisturbanceConfig], bytes([0, 0, 0, 0, 0, 0, 96]))
    link.node.on_frame(frame, END_NS)
    link.tick_until(END_NS + 100 * MS_NS)
    assert link.node.report()["rejected"] == {"out_of_range": 1}
    assert {error for _, error, _ in places(link)} == {0.0}
