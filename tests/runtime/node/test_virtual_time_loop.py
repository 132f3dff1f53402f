from collections.abc import Callable, Sequence
from itertools import pairwise

import pytest

from steer_by_wire.runtime.bus_model.bus_model import BusModel, BusOverflowError
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NEVER_NS
from steer_by_wire.runtime.node.periodic import PeriodicTimer
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor

MS = 1_000_000

Event = tuple[str, str, int]


class ScriptedNode:
    """Sends ``frames`` each period and ``answers`` to each frame, and writes down what it sees."""

    def __init__(
        self,
        name: str,
        events: list[Event],
        *,
        period_ns: int = NEVER_NS,
        start_ns: int = NEVER_NS,
        frames: Sequence[Frame] = (),
        answers: Sequence[Frame] = (),
        ticks: int = 1_000_000,
    ) -> None:
        self.name = name
        self.events = events
        self.timer = PeriodicTimer(start_ns, period_ns)
        self.frames = frames
        self.answers = answers
        self.ticks_left = ticks

    @property
    def deadline_ns(self) -> int:
        return self.timer.deadline_ns

    @property
    def finished(self) -> bool:
        return self.ticks_left == 0

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        self.events.append((self.name, f"got {frame.can_id:X}", now_ns))
        return self.answers

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        self.events.append((self.name, "tick", now_ns))
        self.timer.advance(now_ns)
        self.ticks_left -= 1
        return self.frames


class AlarmNode:
    """Ticks once, ``delay_ns`` after each frame; a negative delay is a deadline in the past."""

    def __init__(self, events: list[Event], delay_ns: int) -> None:
        self.events = events
        self.delay_ns = delay_ns
        self.deadline_ns = NEVER_NS
        self.finished = False

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:  # noqa: ARG002
        self.deadline_ns = now_ns + self.delay_ns
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        self.events.append(("alarm", "tick", now_ns))
        self.deadline_ns = NEVER_NS
        return ()


class StuckNode:
    """Never moves its deadline."""

    deadline_ns = 7
    finished = False

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:  # noqa: ARG002
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:  # noqa: ARG002
        return ()


def periodic(name: str, events: list[Event], *can_ids: int, ticks: int = 1_000_000) -> ScriptedNode:
    frames = [Frame(can_id, bytes(8)) for can_id in can_ids]
    return ScriptedNode(name, events, period_ns=10 * MS, start_ns=0, frames=frames, ticks=ticks)


def recorder() -> tuple[list[tuple[int, int, int]], Callable[[int, int, Frame], None]]:
    wire: list[tuple[int, int, int]] = []
    return wire, lambda time_ns, sender, frame: wire.append((time_ns, sender, frame.can_id))


def test_without_latency_measurement_decision_and_command_happen_at_one_instant() -> None:
    events: list[Event] = []
    executor = VirtualTimeExecutor(
        [periodic("plant", events, 0x110, 0x120), periodic("controller", events, 0x100)]
    )
    executor.run(20 * MS)
    at_one_instant = [
        ("plant", "tick"),
        ("controller", "got 110"),
        ("controller", "got 120"),
        ("controller", "tick"),
        ("plant", "got 100"),
    ]
    assert events == [
        (name, what, now_ns) for now_ns in (0, 10 * MS) for name, what in at_one_instant
    ]


def test_nodes_due_at_one_instant_tick_in_their_sequence() -> None:
    events: list[Event] = []
    VirtualTimeExecutor([periodic(name, events) for name in "cab"]).run(1)
    assert [name for name, _, _ in events] == ["c", "a", "b"]


def test_answers_are_delivered_before_any_further_tick() -> None:
    events: list[Event] = []
    asking = periodic("asking", events, 0x1)
    answering = ScriptedNode("answering", events, answers=[Frame(0x2, b"")])
    VirtualTimeExecutor([asking, answering, periodic("waiting", events)]).run(1)
    assert [event[:2] for event in events] == [
        ("asking", "tick"),
        ("answering", "got 1"),
        ("waiting", "got 1"),
        ("asking", "got 2"),
        ("waiting", "got 2"),
        ("waiting", "tick"),
    ]


def test_a_deadline_in_the_past_ticks_now_and_time_never_turns_back() -> None:
    events: list[Event] = []
    executor = VirtualTimeExecutor([periodic("a", events, 0x1), AlarmNode(events, -5 * MS)])
    executor.run(20 * MS)
    assert [now_ns for name, _, now_ns in events if name == "alarm"] == [0, 10 * MS]
    assert executor.now_ns == 10 * MS


def test_the_run_ends_when_the_first_node_has_finished_its_instant() -> None:
    events: list[Event] = []
    executor = VirtualTimeExecutor([periodic("a", events, 0x1, ticks=3), periodic("b", events)])
    executor.run(1000 * MS)
    assert executor.finished
    assert executor.now_ns == 20 * MS
    assert events[-2:] == [("b", "got 1", 20 * MS), ("b", "tick", 20 * MS)]


def test_the_run_ends_before_until_and_goes_on_as_if_it_had_not() -> None:
    whole: list[Event] = []
    parts: list[Event] = []
    VirtualTimeExecutor([periodic("a", whole, 0x1)], BusModel(125_000)).run(100 * MS)
    executor = VirtualTimeExecutor([periodic("a", parts, 0x1)], BusModel(125_000))
    for until_ns in (10 * MS, 10 * MS + 1, 10 * MS + 500_000, 100 * MS):
        executor.run(until_ns)
    assert parts == whole
    assert len([event for event in whole if event[1] == "tick"]) == 10


def test_a_node_that_never_moves_its_deadline_is_named() -> None:
    with pytest.raises(RuntimeError, match=r"node 1 is still busy .* at 7 ns"):
        VirtualTimeExecutor([ScriptedNode("idle", []), StuckNode()]).run(8)


def test_frames_answered_without_end_at_one_instant_are_an_error() -> None:
    echo = [Frame(0x1, b""), Frame(0x1, b"")]
    nodes = [periodic("a", [], 0x1), ScriptedNode("b", [], answers=echo)]
    nodes[0].answers = echo
    with pytest.raises(RuntimeError, match="at 0 ns"):
        VirtualTimeExecutor(nodes).run(1)


def test_on_a_bus_frames_of_one_instant_compete_and_arrive_one_after_the_other() -> None:
    wire, on_wire = recorder()
    nodes = [periodic("a", [], 0x300, 0x110), periodic("b", [], 0x200)]
    VirtualTimeExecutor(nodes, BusModel(500_000), on_wire).run(10 * MS)
    assert [(sender, can_id) for _, sender, can_id in wire] == [(0, 0x110), (1, 0x200), (0, 0x300)]
    times_ns = [time_ns for time_ns, _, _ in wire]
    # Eight bytes at 500 kbit/s: 108 to 132 bits of 2000 ns each, 3 more between two frames.
    assert 216_000 <= times_ns[0] <= 264_000
    for earlier_ns, later_ns in pairwise(times_ns):
        assert 222_000 <= later_ns - earlier_ns <= 270_000


def test_a_bus_that_cannot_carry_what_the_nodes_send_ends_the_run_with_its_error() -> None:
    bus = BusModel(10_000, queue_limit=10)
    with pytest.raises(BusOverflowError, match="sender 0"):
        VirtualTimeExecutor([periodic("a", [], 0x1, 0x2)], bus).run(1000 * MS)
