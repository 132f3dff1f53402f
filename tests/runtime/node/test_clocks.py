"""Oscillators that are off, and a node that reads every frame wrong."""

from collections.abc import Sequence

import pytest

from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.drifting_clock import DriftingClock
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor

PERIOD_NS = 10_000_000


class Periodic:
    """Ticks every period of its own clock."""

    finished = False

    def __init__(self) -> None:
        self.deadline_ns = 0

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:  # noqa: ARG002
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:  # noqa: ARG002
        self.deadline_ns += PERIOD_NS
        return (Frame(0x100, b""),)


def ticks_ns(ppm: Sequence[float], until_ns: int, drift_ppm_s: float = 0.0) -> list[list[int]]:
    seen: list[list[int]] = [[] for _ in ppm]
    nodes = [DriftingClock(Periodic(), one, drift_ppm_s) for one in ppm]
    executor = VirtualTimeExecutor(nodes, None, lambda now, sender, _: seen[sender].append(now))
    executor.run(until_ns)
    return seen


def test_two_clocks_at_100_ppm_beat_against_each_other() -> None:
    fast_ns, slow_ns = ticks_ns((100, -100), 50_010_000_000)
    # 200 ppm of 50 s is one period: the fast one has ticked once more.
    assert len(fast_ns) - len(slow_ns) == 1
    for index in (0, 1000, 2500):
        apart_ns = slow_ns[index] - fast_ns[index]
        assert apart_ns == pytest.approx(index * PERIOD_NS * 200e-6, abs=5)


def test_a_clock_that_drifts_is_off_by_the_square_of_time() -> None:
    (seen_ns,) = ticks_ns((0,), 10_010_000_000, drift_ppm_s=10.0)
    # Half of 10 ppm/s times (10 s)² is 500 µs.
    assert 10_000_000_000 - seen_ns[1000] == pytest.approx(500_000, rel=2e-3)


def test_a_clock_is_right_when_it_starts() -> None:
    """A program's start is years after that of the clock that it reads."""
    start_ns = 10**17
    node = Periodic()
    node.deadline_ns = start_ns + 1000 * PERIOD_NS
    clock = DriftingClock(node, 100.0, start_ns=start_ns)
    assert clock.local_ns(start_ns) == start_ns
    assert clock.deadline_ns - start_ns == pytest.approx(1000 * PERIOD_NS * (1 - 100e-6), abs=200)
    assert clock.local_ns(clock.deadline_ns) == node.deadline_ns


def test_a_clock_that_is_right_changes_nothing() -> None:
    (seen_ns,) = ticks_ns((0,), 1_000_000_000)
    assert seen_ns == list(range(0, 1_000_000_000, PERIOD_NS))
