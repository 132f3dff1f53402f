"""Occasional commands: what the plant does, reports and counts, and what networks do."""

from itertools import pairwise

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_nodes
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import (
    SteeringStatus,
    SteeringStatusCode,
)
from steer_by_wire.plant_emulator.faults.stage import with_faults
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.settings import load_settings
from tests.support.nodes.plant_link import MS_NS, PERIOD_NS, START_NS, Link, link

HOLDING, FOLLOWING = SteeringStatusCode.HOLDING, SteeringStatusCode.APPLYING
FADING = SteeringStatusCode.LIMITED_BY_SAFETY


def held(tested: Link) -> Link:
    """Half a second of 0.1 rad, and 300 ms without a command."""
    for step in range(51):
        tested.command(START_NS + step * PERIOD_NS, 0.1)
    return tested


def statuses(tested: Link, first_ns: int) -> list[SteeringStatusCode]:
    return [m.status for at_ns, m in tested.messages(SteeringStatus) if at_ns >= first_ns]


BACK_NS = START_NS + 80 * PERIOD_NS


def test_a_hold_is_reported_until_its_run_is_whole_and_then_the_fade_and_nothing_jumps() -> None:
    tested = held(link())
    for step in range(40):
        tested.command(BACK_NS + step * PERIOD_NS, 0.05)
    tested.tick_until(BACK_NS + 40 * PERIOD_NS)
    # The fifth command comes before the fourth sample from here on; 0.05 rad fade in 250 ms.
    assert statuses(tested, BACK_NS + 1) == [HOLDING] * 3 + [FADING] * 21 + [FOLLOWING] * 16
    wheels = [sample.wheel_angle_rad for sample in tested.node.samples]
    steps = [abs(after - before) for before, after in pairwise(wheels[5:])]
    assert max(steps) == pytest.approx(0.002)
    assert wheels[-1] == 0.05
    counters = [m.applied_counter for _, m in tested.messages(SteeringStatus)]
    assert counters[-41:-1] == list(range(51, 91))
    report = tested.node.report()["safety"]
    assert (report["holdings"], report["recoveries"], report["fallbacks"]) == (1, 1, 0)
    assert report["ignored_commands"] == 0


@pytest.mark.parametrize("gap_ms", [150, 500])
def test_single_commands_end_in_fallback_and_are_reported_as_no_recovery(gap_ms: int) -> None:
    tested = held(link())
    for step in range(600 // (gap_ms - 140) + 1):
        tested.command(START_NS + (500 + (step + 1) * gap_ms) * MS_NS, 0.1)
    tested.tick_until(tested.node.deadline_ns + PERIOD_NS)
    reported = set(statuses(tested, START_NS + 640 * MS_NS))
    assert reported == {HOLDING, SteeringStatusCode.FALLBACK}
    report = tested.node.report()["safety"]
    assert (report["holdings"], report["fallbacks"], report["recoveries"]) == (1, 1, 0)
    assert tested.node.report()["safety"]["ignored_commands"] >= 1
    assert tested.node.samples[-1].wheel_angle_rad < 0.1


def pair(outage: str, *overrides: str) -> PlantNode:
    """A run of practical_pd_ddob at 7 km/h with faults of the commands from 2 s on."""
    drop = 'kind="drop", direction="downlink", message="STEERING_COMMAND", onset_s=2.0'
    plant = load_settings(
        PlantSettings,
        None,
        None,
        ["vehicle.speed_m_s=1.9444444444444444", f"faults=[{{{drop}, {outage}}}]", *overrides],
    )
    node = PlantNode(plant, 0)
    edge = with_faults(node, plant.faults, plant.seed)
    controller = ControllerNode(controller_preset("practical_pd_ddob"), 0)
    run_virtual_nodes(edge, controller, None, None, lambda: False)
    return node


def test_a_trickle_of_commands_falls_back() -> None:
    """Of 94 % lost for 8 s, every hold was ended by a single frame."""
    report = pair("duration_s=8.0, magnitude=0.94", "duration_s=10").report()["safety"]
    assert report["fallbacks"] >= 1
    assert report["recoveries"] <= report["holdings"] <= 10
    assert report["longest_silence_s"] < 0.64
