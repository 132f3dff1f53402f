"""A node that does not keep its rate notices, by its own timer; nothing here waits."""

from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.runtime.node.overruns import OverrunSettings, OverrunSupervision, overrun_rule
from steer_by_wire.runtime.node.periodic import PeriodicTimer

MS = 1_000_000
PERIOD_NS = 10 * MS


def supervision(overruns_max: int | str, window: int) -> OverrunSupervision:
    table = {"overruns_max": overruns_max, "window_ticks": window, "missed_periods_max": "off"}
    return OverrunSupervision(overrun_rule(OverrunSettings.model_validate(table)))


def served(supervised: OverrunSupervision, late_periods: Sequence[int]) -> list[bool]:
    """Tick as late as given [periods], one tick after the other; returns the verdicts."""
    timer = PeriodicTimer(0, PERIOD_NS)
    verdicts = []
    for late in late_periods:
        timer.advance(timer.deadline_ns + late * PERIOD_NS)
        verdicts.append(supervised.on_tick(timer))
    return verdicts


def test_as_many_overruns_as_allowed_are_borne_and_one_more_is_not() -> None:
    supervised = supervision(3, 10)
    verdicts = served(supervised, [1, 0, 1, 0, 1, 0, 1, 0])
    assert verdicts == [True] * 6 + [False] * 2
    assert supervised.failure == "4 of the last 7 ticks overran, allowed are 3 of 10"


@given(
    st.lists(st.sampled_from([0, 0, 1, 2, 100_000]), max_size=60),
    st.integers(0, 10),
    st.integers(1, 12),
)
def test_the_verdict_is_that_of_every_window(
    late: list[int], overruns_max: int, window: int
) -> None:
    verdicts = served(supervision(overruns_max, window), late)
    in_window = [
        sum(periods > 0 for periods in late[max(0, end - window) : end])
        for end in range(1, len(late) + 1)
    ]
    assert verdicts == [
        all(count <= overruns_max for count in in_window[:end])
        for end in range(1, len(in_window) + 1)
    ]


def test_overruns_that_are_not_to_be_watched_are_borne_all() -> None:
    watched = supervision(9, 10)
    unwatched = supervision("off", 10)
    assert not served(watched, [1] * 100)[-1]
    assert all(served(unwatched, [1] * 100))
