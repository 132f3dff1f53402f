import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.runtime.node.periodic import PeriodicTimer

starts_ns = st.integers(-(2**62), 2**62)
periods_ns = st.integers(1, 10**10)


def test_serving_before_the_deadline_is_refused() -> None:
    timer = PeriodicTimer(start_ns=100, period_ns=10)
    with pytest.raises(ValueError, match="1 ns too early"):
        timer.advance(99)
    assert (timer.index, timer.deadline_ns) == (0, 100)


@pytest.mark.parametrize("period_ns", [0, -1])
def test_a_period_that_is_not_positive_is_refused(period_ns: int) -> None:
    with pytest.raises(ValueError, match="period_ns must be positive"):
        PeriodicTimer(0, period_ns)


@given(starts_ns, periods_ns, st.lists(st.integers(0, 10**12), max_size=50))
def test_deadlines_stay_on_the_grid_whatever_the_lateness(
    start_ns: int, period_ns: int, latenesses_ns: list[int]
) -> None:
    timer = PeriodicTimer(start_ns, period_ns)
    for calls, lateness_ns in enumerate(latenesses_ns, start=1):
        due_index, now_ns = timer.index, timer.deadline_ns + lateness_ns
        assert timer.advance(now_ns) == due_index
        assert timer.deadline_ns == start_ns + timer.index * period_ns
        assert now_ns < timer.deadline_ns <= now_ns + period_ns
        assert timer.index == calls + timer.skipped
