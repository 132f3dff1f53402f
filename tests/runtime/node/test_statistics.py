import math
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.runtime.node.statistics import DurationStatistics

durations_ns = st.integers(0, 2**62)


def recorded(values_ns: list[int]) -> DurationStatistics:
    statistics = DurationStatistics()
    for value_ns in values_ns:
        statistics.record(value_ns)
    return statistics


def test_a_negative_duration_is_refused() -> None:
    with pytest.raises(ValueError, match="cannot be negative: -1 ns"):
        DurationStatistics().record(-1)


@pytest.mark.parametrize("fraction", [-0.1, 1.1, math.nan])
def test_a_fraction_that_is_none_is_refused(fraction: float) -> None:
    with pytest.raises(ValueError, match="0 to 1"):
        recorded([1]).quantile_ns(fraction)


@given(st.lists(durations_ns, min_size=1, max_size=200), st.floats(0, 1))
def test_a_quantile_is_close_to_the_duration_of_its_rank(
    values_ns: list[int], fraction: float
) -> None:
    rank = max(math.ceil(fraction * len(values_ns)), 1)
    exact_ns = sorted(values_ns)[rank - 1]
    assert recorded(values_ns).quantile_ns(fraction) == pytest.approx(exact_ns, rel=1 / 256, abs=0)


@given(st.lists(durations_ns, min_size=1, max_size=200), st.randoms())
def test_number_mean_and_maximum_are_exact_and_order_does_not_matter(
    values_ns: list[int], random: Random
) -> None:
    report = recorded(values_ns).report()
    assert report["samples"] == len(values_ns)
    assert report["mean_s"] == sum(values_ns) / len(values_ns) / 1e9
    assert report["max_s"] == max(values_ns) / 1e9
    random.shuffle(values_ns)
    assert recorded(values_ns).report() == report


def test_memory_does_not_grow_with_the_length_of_the_run() -> None:
    statistics = DurationStatistics()
    for number in range(200_000):
        statistics.record(number * 7919 % 10_000_019)
    # 17 powers of two above 256 ns, 128 bins each.
    assert len(statistics._bins) <= 256 + 17 * 128
