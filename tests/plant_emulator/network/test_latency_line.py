"""Latency lines: never early, ordered as configured, every frame accounted for, seeded."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import count
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.plant_emulator.network import latency_line
from steer_by_wire.plant_emulator.network.latency_distributions import Distribution
from steer_by_wire.plant_emulator.network.latency_draw import LatencyDraw
from steer_by_wire.plant_emulator.network.latency_line import LatencyLine
from steer_by_wire.plant_emulator.network.random_streams import Stream, uniforms
from steer_by_wire.plant_emulator.network.settings import LatencySettings
from steer_by_wire.runtime.node import NEVER_NS
from tests.support.nodes.pushed_frames import (
    JITTER,
    MS_NS,
    PERIOD_NS,
    Leaving,
    injected_ns,
    line,
    run,
)


class Counted:
    """A stream that knows how many of its numbers were taken."""

    def __init__(self, stream: Iterator[float]) -> None:
        self._stream = stream
        self.taken = 0

    def __iter__(self) -> Iterator[float]:
        return self

    def __next__(self) -> float:
        self.taken += 1
        return next(self._stream)


def numbers_by_key(left: Sequence[Leaving]) -> list[list[int]]:
    by_key: dict[int, list[int]] = defaultdict(list)
    for frame in left:
        by_key[frame.key].append(frame.number)
    return list(by_key.values())


networks = st.fixed_dictionaries(
    {
        "model": st.sampled_from([m.value for m in Distribution if m != Distribution.CONSTANT]),
        "mean_s": st.sampled_from([0.0, 0.001, 0.02, 0.1]),
        "spread_s": st.sampled_from([0.0, 0.001, 0.02, 0.1]),
        "correlation_time_s": st.sampled_from([0.0, 0.005, 0.1]),
        "loss": st.sampled_from([0.0, 0.1, 0.9, 1.0]),
        "burst_frames": st.sampled_from([None, 1.0, 4.0]),
        "order": st.sampled_from(["newest_wins", "in_order", "as_arrives"]),
    }
)
seeds = st.integers(0, 2**63 - 1)
any_network = given(networks, seeds, st.integers(1, 3), st.sampled_from([1, MS_NS, PERIOD_NS]))


@any_network
def test_no_frame_is_early_and_every_frame_is_accounted_for(
    network: dict[str, Any], seed: int, keys: int, period_ns: int
) -> None:
    tested = line(seed, **network)
    left = run(tested, 60, keys, period_ns)
    assert all(frame.left_ns >= frame.came_ns for frame in left)
    assert [frame.left_ns for frame in left] == sorted(frame.left_ns for frame in left)
    counts = tested.counts
    assert counts.pushed == 60
    assert counts.released == len(left) == tested.latency.report()["samples"]
    assert counts.pushed == (counts.released + counts.lost + counts.superseded + counts.overflowed)
    assert tested.injected.report()["samples"] == counts.pushed - counts.lost
    if network["order"] != "newest_wins":
        assert counts.superseded == 0
    assert tested.next_due_ns == NEVER_NS


@any_network
def test_in_order_and_where_the_newest_wins_nothing_older_of_its_key_follows_a_frame(
    network: dict[str, Any], seed: int, keys: int, period_ns: int
) -> None:
    for order in ("in_order", "newest_wins"):
        left = run(line(seed, **{**network, "order": order}), 60, keys, period_ns)
        for numbers in numbers_by_key(left):
            assert numbers == sorted(numbers)


def test_order_is_kept_by_key_only() -> None:
    for order in ("in_order", "newest_wins"):
        tested = line(model="uniform", mean_s=0.05, spread_s=0.02, order=order)
        numbers = [frame.number for frame in run(tested, 200, keys=2)]
        assert numbers != sorted(numbers)


def test_the_three_orders_differ_only_in_what_they_do_to_overtaken_frames() -> None:
    by_order = {
        order: {frame.number: frame.left_ns for frame in run(line(**JITTER, order=order), 500)}
        for order in ("as_arrives", "in_order", "newest_wins")
    }
    free = by_order["as_arrives"]
    newest_ns = 0
    for number in range(500):
        newest_ns = max(newest_ns, free[number])
        assert by_order["in_order"][number] == newest_ns
    winners = {
        number: left_ns
        for number, left_ns in free.items()
        if all(free[later] >= left_ns for later in range(number + 1, 500))
    }
    assert by_order["newest_wins"] == winners
    assert 0 < len(winners) < 500


@pytest.mark.parametrize("order", ["newest_wins", "in_order", "as_arrives"])
def test_without_latency_a_frame_is_due_at_the_very_instant_it_came(order: str) -> None:
    tested = line(order=order)
    now_ns = 123_456_789_012_345_677
    for key in (3, 1, 3):
        tested.push([(key, key)], now_ns, 0)
    assert tested.next_due_ns == now_ns
    assert tested.pop_due(now_ns - 1) == []
    popped = tested.pop_due(now_ns)
    assert [item for _, _, frames in popped for _, item in frames] == [3, 1, 3]
    assert [due_ns - came_ns for due_ns, came_ns, _ in popped] == [0, 0, 0]


# What is drawn


@given(networks, st.integers(0, 50))
def test_two_uniforms_are_taken_for_every_frame_whatever_the_network(
    network: dict[str, Any], frames: int
) -> None:
    stream = Counted(uniforms(1, Stream.UPLINK))
    tested: LatencyLine[tuple[int, int]] = LatencyLine(
        LatencySettings.model_validate(network), lambda _: stream
    )
    for number in range(frames):
        tested.push([(0, number)], number, number)
    assert stream.taken == 2 * frames


def test_the_first_uniform_decides_the_loss_and_the_second_the_latency() -> None:
    def a_line(*numbers: float) -> LatencyLine[tuple[int, int]]:
        table: dict[str, Any] = {"model": "uniform", "mean_s": 0.1, "spread_s": 0.01, "loss": 0.5}
        return LatencyLine(LatencySettings.model_validate(table), lambda _: iter(numbers))

    kept = a_line(0.51, 0.25)
    assert injected_ns(kept, 1) == [round((0.1 - 0.5 * 3**0.5 * 0.01) * 1e9)]
    lost = a_line(0.49, 0.25)
    lost.push([(0, 0)], 0, 0)
    assert lost.counts.lost == 1


def test_frames_that_come_at_one_instant_share_the_state_of_a_correlated_network() -> None:
    tested = line(**JITTER, correlation_time_s=0.1)
    latencies = []
    for number in range(6):
        now_ns = number // 3 * PERIOD_NS
        tested.push([(number, number)], now_ns, 0)
        latencies.append(tested.latest_latency_ns)
    assert len(set(latencies[:3])) == 1
    assert len(set(latencies[3:])) == 1
    assert latencies[0] != latencies[3]


# Bounds


def test_a_line_that_is_full_counts_what_it_cannot_take(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(latency_line, "WAITING_MAX", 3)
    tested = line(mean_s=1.0)
    for number in range(5):
        tested.push([(0, number)], 0, 0)
    assert tested.counts.overflowed == 2
    popped = tested.pop_due(1_000_000_000)
    assert [item for _, _, frames in popped for _, item in frames] == [0, 1, 2]


def test_an_overtaken_frame_at_the_head_does_not_keep_anybody_waiting() -> None:
    """What nobody will get is dropped at once, so it is no deadline."""
    stream = (u for number in count() for u in (0.5, 0.9 if number == 0 else 0.1))
    table: dict[str, Any] = {"model": "uniform", "mean_s": 0.05, "spread_s": 0.02}
    tested: LatencyLine[tuple[int, int]] = LatencyLine(
        LatencySettings.model_validate(table), lambda _: stream
    )
    tested.push([(0, 0)], 0, 0)
    tested.push([(0, 1)], 1, 1)
    (popped,) = tested.pop_due(tested.next_due_ns)
    assert popped[-1] == ((0, 1),)
    assert tested.next_due_ns == NEVER_NS
    assert tested.counts.superseded == 1


@pytest.mark.parametrize("order", ["newest_wins", "in_order", "as_arrives"])
@pytest.mark.parametrize("mean_s", [0.0, 0.02, 0.2])
def test_a_constant_latency_leaves_draws_and_order_as_they_are(
    mean_s: float, order: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def leave(numbers: int) -> list[Any]:
        uplink: LatencyLine[tuple[int, int]] = LatencyLine(
            LatencySettings.model_validate({"mean_s": mean_s, "order": order}),
            partial(uniforms, 5, Stream.UPLINK, None),
        )
        left: list[Any] = []
        for number in range(numbers):
            now_ns = number * PERIOD_NS
            if number == numbers // 2:
                uplink.reconfigure(Distribution.NORMAL, 0.05, 0.02, 0.1)
            if number == numbers * 3 // 4:
                uplink.reconfigure(Distribution.CONSTANT, mean_s, 0.0, 0.0)
            uplink.push([(2, number), (1, -number)], now_ns, now_ns)
            left += [
                (due_ns, came_ns, frame)
                for due_ns, came_ns, frames in uplink.pop_due(now_ns)
                for frame in frames
            ]
        return [left, uplink.counts, uplink.latency.report(), uplink.injected.report()]

    short = leave(200)
    monkeypatch.setattr(LatencyDraw, "_constant_ns", lambda _draw: None)
    assert short == leave(200)
