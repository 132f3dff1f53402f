"""A node that does not keep its rate notices, by its own timer; nothing here waits."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node.overruns import OverrunSettings, OverrunSupervision
from steer_by_wire.runtime.node.periodic import PeriodicTimer
from steer_by_wire.runtime.node.real_time import RealTimeExecutor, Received

MS = 1_000_000
PERIOD_NS = 10 * MS


def served(supervision: OverrunSupervision, late_periods: Sequence[int]) -> list[bool]:
    """Tick as late as given [periods], one tick after the other; returns the verdicts."""
    timer = PeriodicTimer(0, PERIOD_NS)
    verdicts = []
    for late in late_periods:
        timer.advance(timer.deadline_ns + late * PERIOD_NS)
        verdicts.append(supervision.on_tick(timer))
    return verdicts


def test_a_node_that_keeps_its_rate_is_trusted() -> None:
    supervision = OverrunSupervision(0, 100)
    assert all(served(supervision, [0] * 1000))
    assert (supervision.failure, supervision.overruns, supervision.worst) == ("", 0, 0)


def test_as_many_overruns_as_allowed_are_borne_and_one_more_is_not() -> None:
    supervision = OverrunSupervision(3, 10)
    verdicts = served(supervision, [1, 0, 1, 0, 1, 0, 1, 0])
    assert verdicts == [True] * 6 + [False] * 2
    assert supervision.failure == "4 of the last 7 ticks overran, allowed are 3 of 10"


def test_old_overruns_are_forgotten() -> None:
    supervision = OverrunSupervision(2, 10)
    assert all(served(supervision, ([1, 1] + [0] * 8) * 20))
    assert supervision.overruns == 40
    assert supervision.worst == 2


def test_one_stall_is_one_overrun_however_long_it_lasts() -> None:
    supervision = OverrunSupervision(1, 100)
    assert all(served(supervision, [0, 100_000, 0]))
    assert supervision.overruns == 1


def test_lateness_within_the_period_is_none() -> None:
    timer, supervision = PeriodicTimer(0, PERIOD_NS), OverrunSupervision(0, 100)
    for _ in range(100):
        timer.advance(timer.deadline_ns + PERIOD_NS - 1)
        assert supervision.on_tick(timer)


def test_a_fault_stays() -> None:
    supervision = OverrunSupervision(0, 5)
    served(supervision, [1] + [0] * 100)
    assert supervision.failure == "1 of the last 1 ticks overran, allowed are 0 of 5"


@given(st.lists(st.integers(0, 2), max_size=60), st.integers(0, 10), st.integers(1, 12))
def test_the_verdict_is_that_of_every_window(
    late: list[int], overruns_max: int, window: int
) -> None:
    supervision = OverrunSupervision(overruns_max, window)
    verdicts = served(supervision, late)
    in_window = [
        sum(periods > 0 for periods in late[max(0, end - window) : end])
        for end in range(1, len(late) + 1)
    ]
    assert supervision.worst == max(in_window, default=0)
    assert verdicts == [
        all(count <= overruns_max for count in in_window[:end])
        for end in range(1, len(in_window) + 1)
    ]


def test_overruns_that_are_not_to_be_watched_are_borne_all() -> None:
    watched = OverrunSupervision.of(OverrunSettings(overruns_max=9, window_ticks=10))
    unwatched = OverrunSupervision.of(OverrunSettings(overruns_max="off", window_ticks=10))
    assert not served(watched, [1] * 100)[-1]
    assert all(served(unwatched, [1] * 100))


@pytest.mark.parametrize(("overruns_max", "window"), [(-1, 10), (1, 0)])
def test_what_cannot_be_allowed_is_refused(overruns_max: int, window: int) -> None:
    with pytest.raises(ValueError, match="cannot be allowed"):
        OverrunSupervision(overruns_max, window)


class SlowNode:
    """A node whose ticks take ``work_ns`` on the machine that it runs on.

    It does as a controller should: with a fault it sends its safe command, and has then finished.
    """

    def __init__(self, work_ns: int) -> None:
        self.now_ns = 0
        self.supervision = OverrunSupervision.of(OverrunSettings())
        self.ticks = 0
        self._work_ns = work_ns
        self._timer = PeriodicTimer(0, PERIOD_NS)

    @property
    def deadline_ns(self) -> int:
        return self._timer.deadline_ns

    @property
    def finished(self) -> bool:
        return bool(self.supervision.failure)

    def on_frame(self, _frame: Frame, _now_ns: int) -> Sequence[Frame]:
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        self._timer.advance(now_ns)
        self.ticks += 1
        self.now_ns += self._work_ns
        is_trusted = self.supervision.on_tick(self._timer)
        return (Frame(0x100, b"steer" if is_trusted else b"safe"),)


class Machine:
    """A port that waits as long as requested, on a clock that the node's work moves on."""

    def __init__(self, node: SlowNode) -> None:
        self._node = node
        self.sent: list[Frame] = []

    def clock_ns(self) -> int:
        return self._node.now_ns

    def recv(self, timeout_s: float) -> Received | None:
        self._node.now_ns += round(timeout_s * 1e9)
        return None

    def send(self, frame: Frame) -> bool:
        self.sent.append(frame)
        return True


@pytest.mark.parametrize(
    ("work_ms", "keeps_its_rate"), [(1, True), (9, True), (10.5, True), (20.5, False), (100, False)]
)
def test_a_node_too_slow_for_its_rate_ends_in_its_safe_state(
    work_ms: float, keeps_its_rate: bool
) -> None:
    """Half as slow again costs every second tick a period, which the default just bears."""
    node = SlowNode(round(work_ms * MS))
    machine = Machine(node)
    executor = RealTimeExecutor(node, machine, machine.clock_ns)
    executor.run(lambda: node.ticks >= 1000)
    assert node.finished is not keeps_its_rate
    if not keeps_its_rate:
        assert node.ticks <= 2 * OverrunSettings().window_ticks
        assert machine.sent[-1].data == b"safe"
        assert all(frame.data == b"steer" for frame in machine.sent[:-1])
