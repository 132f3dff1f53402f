"""The alarm of a second sender comes in time, and never while there is one sender."""

from collections.abc import Sequence
from random import Random
from typing import NamedTuple

import pytest

from steer_by_wire.dbc.codec.counter_check import CounterCheck
from steer_by_wire.dbc.codec.counter_rule import CounterRule

MS = 1_000_000


class Arrival(NamedTuple):
    """A frame: when it arrives, its counter, and a number that stands for its content."""

    time_ns: int
    counter: int
    content: int


class Pair(NamedTuple):
    """Two senders: their frames, from when on both arrive, and the period of the slower one."""

    arrivals: list[Arrival]
    both_from_ns: int
    period_ns: int


def drawn_pair(random: Random) -> Pair:
    """Draw rate, phase, first counter and latency of two senders; the second may join later."""
    period_ms = random.choice((1.0, 5.0, 10.0, 20.0, 100.0, random.uniform(1.0, 100.0)))
    other_ms = random.choice((period_ms, period_ms, random.uniform(1.0, 100.0)))
    joins_ms = random.choice((0.0, random.uniform(0.0, 3000.0)))
    both, arrivals = [], []
    for sender, (each_ms, from_ms) in enumerate(((period_ms, 0.0), (other_ms, joins_ms))):
        first, latency_ms = random.randrange(256), random.uniform(0.0, 500.0)
        begin_ms = from_ms + random.uniform(0.0, each_ms) + latency_ms
        both.append(begin_ms)
        for number in range(round((joins_ms + 2000.0) / each_ms)):
            time_ns = round((begin_ms + number * each_ms) * MS)
            arrivals.append(Arrival(time_ns, (first + number) % 256, 2 * number + sender))
    return Pair(sorted(arrivals), round(max(both) * MS), round(max(period_ms, other_ms) * MS))


def drawn_network(random: Random) -> tuple[str, list[Arrival]]:
    """Draw a network for one sender; frames overtake by less than 128, and may be lost or doubled.

    The sender may restart with any counter, if frames are less than 0.35 s on their way.
    """
    period_ms = random.choice((1, 2, 5, 10, 20, 50, 100))
    spread_ms = random.uniform(0.0, 126.5) * period_ms
    kind = random.choice(("any delay", "two paths", "latency rises and falls", "drifting"))
    restarts = random.random() < 0.5
    if restarts:
        spread_ms = min(spread_ms, 349.0)
    if kind == "latency rises and falls":
        spread_ms = min(spread_ms, 690.0)
    share, loss = random.random(), random.choice((0.0, 0.01, 0.1, 0.5))
    doubled = random.choice((0.0, 0.1, 1.0))
    late_ms, counter, arrivals = 0.0, random.randrange(256), []
    for number in range(1200):
        if restarts and number == 600:
            counter = random.randrange(256)
        if kind == "any delay":
            late_ms = random.uniform(0.0, spread_ms)
        elif kind == "two paths":
            late_ms = spread_ms * (random.random() < share)
        elif kind == "latency rises and falls":
            late_ms = spread_ms * (number // 40 % 2)
        else:
            late_ms = min(max(late_ms + random.uniform(-0.1, 0.1) * spread_ms, 0.0), spread_ms)
        copies = [late_ms] * (random.random() >= loss)
        copies += [random.uniform(0.0, spread_ms)] * (random.random() < doubled)
        arrivals += [
            Arrival(round((number * period_ms + one) * MS), counter, number) for one in copies
        ]
        counter = (counter + 1) % 256
    return f"{kind}, {period_ms} ms, {spread_ms:.0f} ms, {loss:.0%} lost", sorted(arrivals)


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
