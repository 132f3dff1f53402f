"""Oscillators that are off, and a node that reads every frame wrong."""

from collections.abc import Sequence

import pytest

from steer_by_wire.runtime.bus_model.bit_noise import BusNoise, NoiseRates
from steer_by_wire.runtime.bus_model.bus_errors import BusErrors
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NEVER_NS
from steer_by_wire.runtime.node.drifting_clock import DriftingClock
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor

PERIOD_NS = 10_000_000
BIT_NS = 2_000


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


class WrongRate:
    """Noise of a node at another bit rate: a stuff error by the tenth bit of every frame."""

    def first_hit_ns(self, start_ns: int, end_ns: int) -> int | None:
        return start_ns if end_ns == NEVER_NS else start_ns + 9 * BIT_NS + BIT_NS // 2


def test_a_node_at_a_wrong_rate_is_kept_out_and_the_others_go_on() -> None:
    noise = BusNoise(NoiseRates(0.0), 500_000, 1)
    errors = BusErrors(noise, noise_of={2: WrongRate()})
    for node in range(3):
        errors.join(node)
    bus, received = BusModel(500_000, errors=errors), 0
    for number in range(300):
        now_ns = number * 1_000_000
        while bus.next_event_ns <= now_ns:
            received += len(bus.advance(bus.next_event_ns))
        bus.submit(Frame(0x100 + number % 2, b"12345678"), number % 2, now_ns)
        if number == 100:
            bus.submit(Frame(0x050, b""), 2, now_ns)
    while bus.next_event_ns < NEVER_NS:
        received += len(bus.advance(bus.next_event_ns))
    assert errors.bus_offs == 1
    assert bus.lost_in_bus_off == 1
    assert received == 300  # none of the others' frames is lost
