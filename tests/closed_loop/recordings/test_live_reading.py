"""Lateness of frames that are read from a port with and without arrival times."""

from collections import deque

import pytest

from steer_by_wire.closed_loop.recordings.live_reading import TIMED_NS, LiveReader
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.real_time_loop import Received

MS = 1_000_000
FRAME = Frame(0x100, bytes(8))


class Bus:
    """A port with a clock: frames come at their times, a program is held up when told."""

    def __init__(self, *arrivals_ms: int, has_times: bool) -> None:
        self.now_ns = 0
        self.held_up_ns = 0
        self._arrivals_ns = deque(at * MS for at in arrivals_ms)
        self._has_times = has_times

    def recv(self, timeout_s: float) -> Received | None:
        end_ns = self.now_ns + round(timeout_s * 1e9)
        next_ns = self._arrivals_ns[0] if self._arrivals_ns else end_ns + 1
        self.now_ns = max(min(next_ns, end_ns), self.now_ns) + self.held_up_ns
        if next_ns > self.now_ns:
            return None
        arrival_ns = self._arrivals_ns.popleft()
        return Received(FRAME, arrival_ns if self._has_times else None)

    def send(self, frame: Frame) -> bool:
        raise NotImplementedError


@pytest.mark.parametrize("has_times", [True, False])
def test_a_program_that_keeps_up_has_the_time_of_every_frame(has_times: bool) -> None:
    bus = Bus(*range(5, 500, 10), has_times=has_times)
    reader = LiveReader(bus, lambda: bus.now_ns)
    frames = []
    while bus.now_ns < 500 * MS:
        read = reader.next(bus.now_ns + 1000 * MS)
        frames += [read] if read is not None else []
    assert [read.time_ns // MS for read in frames] == list(range(5, 500, 10))
    assert all(read.has_time for read in frames)
    assert max(read.late_ns for read in frames) <= TIMED_NS // 2


def test_what_waited_while_the_program_did_something_else_has_no_time() -> None:
    bus = Bus(10, 20, 30, 205, has_times=False)
    reader = LiveReader(bus, lambda: bus.now_ns)
    assert reader.next(MS) is None
    bus.now_ns = 200 * MS
    reads = [reader.next(300 * MS) for _ in range(4)]
    assert [read and (read.late_ns // MS, read.has_time) for read in reads] == [
        (199, False), (199, False), (199, False), (5, True)
    ]  # fmt: skip


def test_where_the_port_knows_the_arrival_it_stands_and_the_wait_is_known() -> None:
    bus = Bus(10, 20, has_times=True)
    reader = LiveReader(bus, lambda: bus.now_ns)
    bus.now_ns = 200 * MS
    assert reader.next(300 * MS) == (FRAME, 10 * MS, 190 * MS, True)
    assert reader.next(300 * MS) == (FRAME, 20 * MS, 180 * MS, True)
