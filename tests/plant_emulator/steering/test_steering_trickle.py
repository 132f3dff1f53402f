"""Occasional commands: what the plant does, reports and counts, and what networks do."""

from itertools import pairwise

import pytest

from steer_by_wire.dbc.messages import (
    SteeringStatus,
    SteeringStatusCode,
)
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
