"""A node that does not keep its rate notices, by its own timer; nothing here waits."""

from collections.abc import Sequence
from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.runtime.node.overruns import (
    OverrunRule,
    OverrunSettings,
    OverrunSupervision,
    overrun_rule,
)
from steer_by_wire.runtime.node.periodic import PeriodicTimer

PERIOD_NS = 10_000_000


def by_settings(**table: int | str) -> OverrunSupervision:
    return OverrunSupervision(overrun_rule(OverrunSettings.model_validate(table)))


def served(supervised: OverrunSupervision, late_periods: Sequence[int]) -> list[bool]:
    """Tick as late as given [periods], one tick after the other; returns the verdicts."""
    timer = PeriodicTimer(0, PERIOD_NS)
    verdicts = []
    for late in late_periods:
        timer.advance(timer.deadline_ns + late * PERIOD_NS)
        verdicts.append(supervised.on_tick(timer))
    return verdicts


@given(
    st.lists(st.integers(0, 9) | st.sampled_from([0, 0, 100_000]), max_size=60),
    st.tuples(st.integers(0, 10), st.integers(1, 12)),
    st.tuples(st.integers(0, 12), st.integers(1, 20), st.integers(1, 12)),
)
def test_the_verdict_is_that_of_the_last_ticks_and_periods_one_by_one(
    late: list[int], ticks: tuple[int, int], periods: tuple[int, int, int]
) -> None:
    overruns_max, window_ticks = ticks
    missed_max, window_periods, stall_max = periods
    missed, keeps = list[bool](), list[bool]()
    for end, one in enumerate(late, 1):
        missed += [False] + [True] * min(one, stall_max)
        overruns = sum(skipped > 0 for skipped in late[max(0, end - window_ticks) : end])
        keeps.append(overruns <= overruns_max and sum(missed[-window_periods:]) <= missed_max)
    supervised = OverrunSupervision(OverrunRule(*ticks, *periods))
    assert served(supervised, late) == list(accumulate(keeps, min))


def test_as_many_overruns_as_allowed_are_borne_and_one_more_is_not() -> None:
    supervised = by_settings(overruns_max=3, window_ticks=10, missed_periods_max="off")
    verdicts = served(supervised, [1, 0, 1, 0, 1, 0, 1, 0])
    assert verdicts == [True] * 6 + [False] * 2
    assert supervised.failure == "4 of the last 7 ticks overran, allowed are 3 of 10"


def test_a_node_stopped_for_most_of_the_time_has_a_fault() -> None:
    """120 ms of every 150: four ticks are served, of which one overruns, and eleven missed."""
    supervised = by_settings()
    assert served(supervised, [11, 0, 0, 0] * 46).index(False) == 4 * 45
    assert supervised.failure == (
        "506 of the last 687 periods were missed, a stall counted as 250 at most, "
        "allowed are 500 of 1000"
    )


@pytest.mark.parametrize(
    ("stalls", "served_ticks"),
    [([10_000_000], 1000), ([10_000_000] * 2, 1), ([10_000_000] * 100, 250), ([50] * 1000, 100)],
    ids=["one for a day", "two", "one every 2.5 s", "half a second every 1.5 s"],
)
def test_stalls_now_and_then_are_borne_however_long(stalls: list[int], served_ticks: int) -> None:
    late = [tick for stall in stalls for tick in [stall] + [0] * (served_ticks - 1)]
    assert all(served(by_settings(), late))


def test_overruns_that_are_not_to_be_watched_are_borne_all() -> None:
    assert not served(by_settings(), [1] * 100)[-1]
    assert all(served(by_settings(overruns_max="off", missed_periods_max="off"), [1] * 1000))
