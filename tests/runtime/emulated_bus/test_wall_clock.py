"""Times of the monotonic clock as times of the wall clock, with clocks that a test moves."""

import pytest

from steer_by_wire.runtime.emulated_bus.wall_clock import WallClock

SECOND_NS = 1_000_000_000


class Clocks:
    """Stands for the module ``time``: both clocks, and how long a reading takes."""

    def __init__(self) -> None:
        self.now_ns = 5 * SECOND_NS
        self.wall_offset_ns = 1_700_000_000 * SECOND_NS
        self.reading_ns = 0

    def monotonic_ns(self) -> int:
        return self.now_ns

    def time_ns(self) -> int:
        self.now_ns += self.reading_ns
        return self.now_ns + self.wall_offset_ns


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Clocks:
    clocks = Clocks()
    monkeypatch.setattr("steer_by_wire.runtime.emulated_bus.wall_clock.time", clocks)
    return clocks


def test_distances_are_kept_while_the_wall_clock_is_trimmed(clocks: Clocks) -> None:
    wall_clock = WallClock()
    before = wall_clock.at(0)
    clocks.wall_offset_ns += 900_000
    wall_clock.update()
    assert wall_clock.at(1) - before == 1


def test_a_wall_clock_that_was_set_is_followed(clocks: Clocks) -> None:
    wall_clock = WallClock()
    clocks.wall_offset_ns += 3600 * SECOND_NS
    wall_clock.update()
    assert wall_clock.at(clocks.now_ns) == clocks.now_ns + clocks.wall_offset_ns


def test_a_reading_that_was_interrupted_is_not_believed(clocks: Clocks) -> None:
    wall_clock = WallClock()
    before = wall_clock.at(0)
    clocks.reading_ns = SECOND_NS // 2
    wall_clock.update()
    assert wall_clock.at(0) == before
