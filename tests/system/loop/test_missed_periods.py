"""A node whose host leaves it too little time notices by the periods it misses; nothing waits."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import encode
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.overruns import (
    OverrunRule,
    OverrunSettings,
    OverrunSupervision,
    overrun_rule,
)
from steer_by_wire.runtime.node.periodic import PeriodicTimer
from tests.support.frames.made_messages import error_of
from tests.support.nodes.plant_link import PERIOD_NS, START_NS, link

MS = 1_000_000
PRESET = "practical_pd_ddob"


def starved(supervision: OverrunSupervision, stalls: Sequence[int], served: int) -> list[str]:
    """Miss so many periods, then serve some on time, repeatedly; returns what is reported."""
    timer = PeriodicTimer(0, PERIOD_NS)
    failures = []
    for missed in stalls:
        for late in [missed] + [0] * (served - 1):
            timer.advance(timer.deadline_ns + late * PERIOD_NS)
            supervision.on_tick(timer)
        failures.append(supervision.failure)
    return failures


def by_default() -> OverrunSupervision:
    return supervision(OverrunSettings())


def supervision(settings: OverrunSettings) -> OverrunSupervision:
    return OverrunSupervision(overrun_rule(settings))


def test_a_node_stopped_for_most_of_the_time_has_a_fault() -> None:
    """120 ms of every 150: four ticks are served, of which one overruns, and eleven missed."""
    failures = starved(by_default(), [11] * 46, 4)
    assert failures[44] == ""
    assert failures[45] == (
        "506 of the last 687 periods were missed, a stall counted as 250 at most, "
        "allowed are 500 of 1000"
    )


@pytest.mark.parametrize(
    ("stalls", "served"),
    [([10_000_000], 1000), ([10_000_000] * 2, 1), ([10_000_000] * 100, 250), ([50] * 1000, 100)],
    ids=["one for a day", "two", "one every 2.5 s", "half a second every 1.5 s"],
)
def test_stalls_now_and_then_are_borne_however_long(stalls: list[int], served: int) -> None:
    assert not starved(by_default(), stalls, served)[-1]


@given(
    st.lists(st.integers(0, 9) | st.just(0), max_size=60),
    st.integers(0, 12),
    st.integers(1, 20),
    st.integers(1, 12),
)
def test_the_verdict_is_that_of_the_last_periods_one_by_one(
    late: list[int], missed_max: int, window: int, stall_max: int
) -> None:
    judged = OverrunSupervision(OverrunRule(100, 100, missed_max, window, stall_max))
    timer, periods = PeriodicTimer(0, PERIOD_NS), list[bool]()
    for missed in late:
        timer.advance(timer.deadline_ns + missed * PERIOD_NS)
        kept = judged.on_tick(timer)
        periods += [False] + [True] * min(missed, stall_max)
        count = sum(periods[-window:])
        assert kept is (count <= missed_max)
        if not kept:
            said = f"{count} of the last {min(window, len(periods))} periods"
            assert judged.failure.startswith(said)
            return


def test_a_starved_controller_stops_steering_for_good_and_says_why() -> None:
    settings = controller_preset(PRESET)
    node = ControllerNode(settings, 0)
    frames: list[Frame] = []
    for cycle in range(100):
        for offset in range(4):
            now_ns = cycle * 150 * MS + offset * 10 * MS + MS // 20
            counter = (4 * cycle + offset) % 256
            node.on_frame(encode(error_of(0.01), counter), now_ns)
            frames += node.on_tick(now_ns)
    report = node.report()
    assert "periods were missed" in report["failure"]
    # Found within half of the fifteen seconds.
    assert report["mode_s"]["safe_stop"] > 7.0


@pytest.mark.parametrize(("stalls", "fails"), [(45, False), (46, True)])
def test_a_starved_plant_ends_in_its_safe_state(stalls: int, fails: bool) -> None:
    tested = link(duration_s=1e6)
    tested.command(START_NS, 0.1)
    for _ in range(stalls):
        tested.tick(tested.node.deadline_ns + 11 * PERIOD_NS)
        tested.tick_until(tested.node.deadline_ns + 2 * PERIOD_NS)
    failure = tested.node.report()["failure"]
    assert ("periods were missed" in failure) is fails
