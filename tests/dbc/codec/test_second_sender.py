"""The alarm of a second sender comes in time, and never while there is one sender."""

from collections.abc import Sequence
from random import Random

import pytest

from steer_by_wire.dbc.codec.counter_check import CounterCheck
from steer_by_wire.dbc.codec.counter_rule import CounterRule
from tests.support.frames.drawn_arrivals import MS, Arrival, drawn_network, drawn_pair

RULES = (
    CounterRule(40 * MS, 5, 140 * MS, 10 * MS),  # of commands
    CounterRule(300 * MS, 5, 145 * MS, 10 * MS),  # of measurements
)
PAIRS, NETWORKS = 1000, 400


def noticed_ns(arrivals: Sequence[Arrival], rule: CounterRule) -> int | None:
    """When the alarm comes; None for never."""
    check = CounterCheck(rule)
    for time_ns, counter, content in arrivals:
        check.check(counter, time_ns, content)
        if check.second_sender_ns is not None:
            return check.second_sender_ns
    return None


def test_of_a_thousand_pairs_each_is_noticed_within_a_second_or_ten_cycles() -> None:
    random = Random(1)
    for number in range(PAIRS):
        pair = drawn_pair(random)
        noticed = noticed_ns(pair.arrivals, RULES[number % 2])
        assert noticed is not None, number
        late_ns = noticed - pair.both_from_ns
        assert 0 < late_ns <= max(1000 * MS, 10 * pair.period_ns), number


@pytest.mark.parametrize("seed", range(4))
def test_on_no_network_is_one_sender_taken_for_two(seed: int) -> None:
    random = Random(seed)
    for _ in range(NETWORKS // 4):
        name, arrivals = drawn_network(random)
        assert noticed_ns(arrivals, random.choice(RULES)) is None, name


@pytest.mark.parametrize("step", [1, -1, 0])
def test_equal_frames_are_doubled_ones(step: int) -> None:
    """Two senders of equal contents, whose counters differ by little, cannot be told apart."""
    frames = [Arrival(n * 10 * MS, n % 256, n) for n in range(400)]
    again = [one._replace(time_ns=one.time_ns + (5 + 10 * step) * MS) for one in frames]
    assert noticed_ns(sorted(frames + again), RULES[0]) is None


def test_the_alarm_ends_with_the_second_sender() -> None:
    frames = [Arrival(n * 10 * MS, n % 256, 0) for n in range(1000)]
    others = [Arrival(n * 10 * MS + 5 * MS, (n + 90) % 256, 1) for n in range(300)]
    check = CounterCheck(RULES[0])
    for time_ns, counter, content in sorted(frames + others):
        check.check(counter, time_ns, content)
    assert check.second_sender_ns is not None
    assert check.second_sender_ns < 3100 * MS
