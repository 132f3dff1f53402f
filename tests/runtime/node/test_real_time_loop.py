"""The real-time executor with a fake clock and a fake port: nothing here waits."""

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from steer_by_wire.runtime.exit_status import BusError
from steer_by_wire.runtime.frame import ERROR, Frame
from steer_by_wire.runtime.node import NEVER_NS
from steer_by_wire.runtime.node.periodic import PeriodicTimer
from steer_by_wire.runtime.node.real_time_loop import (
    FRAMES_PER_WAKE_UP_MAX,
    TICKS_PER_WAKE_UP_MAX,
    WAIT_NS_MAX,
    RealTimeExecutor,
    Received,
)

MS = 1_000_000
ANSWER = Frame(0x200, b"answer")
COMMAND = Frame(0x100, b"command")


def frame(number: int) -> Frame:
    return Frame(0x300, number.to_bytes(8, "little"))


class Machine:
    """A port with its clock: frames arrive when they are due, waiting takes time, as does work.

    ``arrivals``      frames and when they arrive [ns], in order
    ``oversleep_ns``  how much longer than asked for a wait without a frame lasts
    ``wake_up_ns``    how long after the arrival of a frame a wait ends
    ``reports_arrivals``  whether the port knows when a frame arrived
    """

    def __init__(
        self,
        arrivals: Sequence[tuple[int, Frame]] = (),
        oversleep_ns: int = 0,
        start_ns: int = 0,
        wake_up_ns: int = 0,
        reports_arrivals: bool = False,
    ) -> None:
        self.now_ns = start_ns
        self.readings_ns: list[int] = []
        self.waits_ns: list[int] = []
        self.sent: list[Frame] = []
        self.bus_fails = False
        self.bus_is_full = False
        self._arrivals = list(arrivals)
        self._oversleep_ns = oversleep_ns
        self._wake_up_ns = wake_up_ns
        self._reports_arrivals = reports_arrivals

    def clock_ns(self) -> int:
        self.readings_ns.append(self.now_ns)
        return self.now_ns

    def recv(self, timeout_s: float) -> Received | None:
        timeout_ns = round(timeout_s * 1e9)
        self.waits_ns.append(timeout_ns)
        if self._arrivals and self._arrivals[0][0] <= self.now_ns + timeout_ns:
            arrival_ns, arrived = self._arrivals.pop(0)
            if arrival_ns > self.now_ns:
                self.now_ns = arrival_ns + self._wake_up_ns
            return Received(arrived, arrival_ns if self._reports_arrivals else None)
        if timeout_ns:
            self.now_ns += timeout_ns + self._oversleep_ns
        return None

    def send(self, sent: Frame) -> bool:
        if self.bus_fails:
            raise BusError("cannot send: bus-off")
        if self.bus_is_full:
            return False
        self.sent.append(sent)
        return True


class Recorder:
    """A periodic node that notes its calls, answers every frame, and can be made slow."""

    def __init__(
        self,
        ticks: int = NEVER_NS,
        period_ns: int = 10 * MS,
        work: Callable[[int], None] = lambda _tick: None,
    ) -> None:
        self._timer = PeriodicTimer(0, period_ns)
        self._ticks = ticks
        self._work = work
        self.calls: list[tuple[str, int]] = []

    @property
    def deadline_ns(self) -> int:
        return self._timer.deadline_ns

    @property
    def finished(self) -> bool:
        return len(self.tick_times_ns) >= self._ticks

    @property
    def tick_times_ns(self) -> list[int]:
        return [now_ns for call, now_ns in self.calls if call == "tick"]

    def on_frame(self, _frame: Frame, now_ns: int) -> Sequence[Frame]:
        self.calls.append(("frame", now_ns))
        return (ANSWER,)

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        self.calls.append(("tick", now_ns))
        self._timer.advance(now_ns)
        self._work(len(self.tick_times_ns))
        return (COMMAND,)


def never() -> bool:
    return False


def run(
    node: Recorder, machine: Machine, should_stop: Callable[[], bool] = never
) -> dict[str, Any]:
    executor = RealTimeExecutor(node, machine, machine.clock_ns)
    executor.run(should_stop)
    return executor.report()


def test_ticks_are_on_the_grid_and_the_node_ends_the_run() -> None:
    node, machine = Recorder(ticks=4), Machine()
    figures = run(node, machine)
    assert node.tick_times_ns == [0, 10 * MS, 20 * MS, 30 * MS]
    assert machine.sent == [COMMAND] * 4
    assert figures["lateness"]["samples"] == 4
    assert figures["lateness"]["max_s"] == 0
    assert (figures["frames_received"], figures["frames_sent"], figures["overdue"]) == (0, 4, 0)


def test_oversleeping_is_lateness_and_does_not_add_up() -> None:
    node = Recorder(ticks=4)
    figures = run(node, Machine(oversleep_ns=3 * MS))
    assert node.tick_times_ns == [0, 13 * MS, 23 * MS, 33 * MS]
    assert figures["lateness"]["max_s"] == pytest.approx(3 * MS * 1e-9)
    assert figures["overdue"] == 0


def test_frames_that_wait_are_handed_over_before_the_tick_with_the_same_reading() -> None:
    node = Recorder(ticks=2)
    machine = Machine([(10 * MS, frame(1)), (10 * MS, frame(2))])
    figures = run(node, machine)
    assert node.calls == [("tick", 0), ("frame", 10 * MS), ("frame", 10 * MS), ("tick", 10 * MS)]
    assert machine.sent == [COMMAND, ANSWER, ANSWER, COMMAND]
    assert (figures["frames_received"], figures["frames_sent"]) == (2, 4)


def test_a_frame_before_the_deadline_is_handed_over_when_it_arrives() -> None:
    node = Recorder(ticks=2)
    run(node, Machine([(4 * MS, frame(1))]))
    assert node.calls == [("tick", 0), ("frame", 4 * MS), ("tick", 10 * MS)]


def test_a_node_is_reported_no_time_of_the_future_and_none_before_its_last() -> None:
    class Confused(Machine):
        """Its arrivals are off, as after the wall clock was set."""

        offset_ns = 0

        def recv(self, timeout_s: float) -> Received | None:
            received = super().recv(timeout_s)
            return received and Received(received.frame, self.now_ns + self.offset_ns)

    for offset_ns, told_ns in [(60 * MS, 14 * MS), (-60 * MS, 10 * MS)]:
        node, machine = Recorder(ticks=3), Confused([(14 * MS, frame(1))])
        machine.offset_ns = offset_ns
        run(node, machine)
        assert node.calls[1:3] == [("tick", 10 * MS), ("frame", told_ns)]


@pytest.mark.parametrize("reports_arrivals", [True, False])
def test_no_frame_is_handed_over_as_of_a_time_before_its_arrival(reports_arrivals: bool) -> None:
    """A latency that began too early would end too early."""

    class Stalled(Recorder):
        def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
            machine.now_ns += 3 * MS
            return super().on_frame(frame, now_ns)

    node = Stalled(ticks=2)
    machine = Machine([(4 * MS, frame(1)), (6 * MS, frame(2))], reports_arrivals=reports_arrivals)
    figures = run(node, machine)
    second_ns = 6 * MS if reports_arrivals else 7 * MS
    assert node.calls == [("tick", 0), ("frame", 4 * MS), ("frame", second_ns), ("tick", 10 * MS)]
    assert figures["busy_fraction"] * figures["duration_s"] == pytest.approx(6 * MS * 1e-9)
    assert figures["lateness"]["max_s"] == 0


def test_work_beyond_the_next_deadline_leaves_no_wait_and_keeps_phase() -> None:
    machine = Machine()

    def work(tick: int) -> None:
        machine.now_ns += 14 * MS if tick == 2 else 0

    node = Recorder(ticks=4, work=work)
    figures = run(node, machine)
    assert node.tick_times_ns == [0, 10 * MS, 24 * MS, 30 * MS]
    assert figures["overdue"] == 1
    assert figures["lateness"]["max_s"] == pytest.approx(4 * MS * 1e-9)


def test_error_frames_are_no_node_s_business() -> None:
    node = Recorder(ticks=2)
    error = Frame(0x300, bytes(8), ERROR)
    figures = run(node, Machine([(4 * MS, error), (4 * MS, frame(1)), (5 * MS, error)]))
    assert node.calls == [("tick", 0), ("frame", 4 * MS), ("tick", 10 * MS)]
    assert figures["frames_received"] == 1


def test_a_flood_does_not_keep_the_node_from_ticking_and_what_it_leaves_comes_at_once() -> None:
    node = Recorder(ticks=3)
    flood = [(10 * MS, frame(number)) for number in range(FRAMES_PER_WAKE_UP_MAX + 5)]
    figures = run(node, Machine(flood))
    calls = [call for call, now_ns in node.calls if now_ns <= 10 * MS]
    assert calls == ["tick", *["frame"] * FRAMES_PER_WAKE_UP_MAX, "tick", *["frame"] * 5]
    assert figures["full_wake_ups"] == 1
    assert figures["frames_received"] == FRAMES_PER_WAKE_UP_MAX + 5


def test_a_request_to_stop_is_heard_while_a_deadline_is_far_away() -> None:
    node, machine = Recorder(period_ns=3600 * 1000 * MS), Machine()
    run(node, machine, should_stop=lambda: machine.now_ns >= 1000 * MS)
    assert max(machine.waits_ns) == WAIT_NS_MAX
    assert machine.now_ns < 1000 * MS + WAIT_NS_MAX
    assert node.tick_times_ns == [0]


def test_a_bus_that_fails_ends_the_run_and_leaves_its_figures() -> None:
    machine = Machine()

    def work(tick: int) -> None:
        machine.bus_fails = tick == 3

    executor = RealTimeExecutor(Recorder(work=work), machine, machine.clock_ns)
    with pytest.raises(BusError, match="bus-off"):
        executor.run(never)
    assert executor.report()["frames_sent"] == 2
    assert executor.report()["lateness"]["samples"] == 3


def test_a_frame_that_the_bus_has_no_room_for_is_counted_and_not_sent_again() -> None:
    machine = Machine()

    def work(tick: int) -> None:
        machine.bus_is_full = tick == 2

    figures = run(Recorder(ticks=4, work=work), machine)
    assert machine.sent == [COMMAND] * 3
    assert (figures["frames_sent"], figures["frames_refused"]) == (3, 1)


def test_a_node_whose_deadline_does_not_move_on_is_an_error_and_no_hang() -> None:
    class Stuck(Recorder):
        @property
        def deadline_ns(self) -> int:
            return 0

        def on_tick(self, now_ns: int) -> Sequence[Frame]:
            self.calls.append(("tick", now_ns))
            return ()

    node, machine = Stuck(), Machine()
    with pytest.raises(RuntimeError, match="deadline does not move on"):
        run(node, machine)
    assert len(node.tick_times_ns) == TICKS_PER_WAKE_UP_MAX
