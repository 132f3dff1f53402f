"""A latency line, the frames that a test pushes into it, and what leaves it when."""

from functools import partial
from typing import Any, NamedTuple

from steer_by_wire.plant_emulator.network.latency_line import LatencyLine
from steer_by_wire.plant_emulator.network.random_streams import Stream, uniforms
from steer_by_wire.plant_emulator.network.settings import LatencySettings
from steer_by_wire.runtime.node import NEVER_NS

MS_NS = 1_000_000
PERIOD_NS = 10 * MS_NS
JITTER: dict[str, Any] = {"model": "normal", "mean_s": 0.08, "spread_s": 0.03}


class Leaving(NamedTuple):
    """One frame that left; ``number`` counts the frames as they were pushed."""

    number: int
    key: int
    came_ns: int
    left_ns: int


def line(seed: int = 1, **table: Any) -> LatencyLine[tuple[int, int]]:
    stream = partial(uniforms, seed, Stream.UPLINK, None)
    return LatencyLine(LatencySettings.model_validate(table), stream)


def run(
    tested: LatencyLine[tuple[int, int]], frames: int, keys: int = 1, period_ns: int = PERIOD_NS
) -> list[Leaving]:
    """Push frames of all keys in turn, pop whenever something is due, until the line is empty."""
    left: list[Leaving] = []
    came: dict[int, int] = {}
    for number in range(frames):
        now_ns = number * period_ns
        pop_until(tested, now_ns, came, left)
        came[number] = now_ns
        tested.push([(number % keys, number)], now_ns, now_ns)
    pop_until(tested, NEVER_NS - 1, came, left)
    return left


def pop_until(
    tested: LatencyLine[tuple[int, int]], until_ns: int, came: dict[int, int], left: list[Leaving]
) -> None:
    while tested.next_due_ns <= until_ns:
        now_ns = tested.next_due_ns
        popped = tested.pop_due(now_ns)
        assert popped, "something was due, and nothing left"
        for due_ns, came_ns, frames in popped:
            assert due_ns == now_ns
            for key, item in frames:
                assert came_ns == came[item]
                left.append(Leaving(item, key, came_ns, now_ns))
    assert tested.pop_due(until_ns) == []


def injected_ns(tested: LatencyLine[tuple[int, int]], frames: int) -> list[int]:
    """The latency drawn for each frame, lost ones not counted."""
    drawn = []
    for number in range(frames):
        tested.push([(0, number)], number * PERIOD_NS, number * PERIOD_NS)
        drawn.append(tested.latest_latency_ns)
    return drawn
