"""Drives the node in Python, keeps what it was given and sent, and compares the node in C with it.

The C runs afterwards, as one process for many runs: two processes that wait for each other, record
by record, take minutes for seconds on a busy machine.
"""

import random
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from steer_by_wire.closed_loop.lockstep.record import (
    DEADLINE,
    FRAME_BYTES,
    FRAMES,
    FRAMES_MAX,
    RECORD_BYTES,
    START,
    Arrival,
    Record,
    pack,
    unpack,
)
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    COMMAND_COUNTERS,
    DelayStatus,
    EchoState,
    LateralError,
    PathAhead,
    Sender,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
    encode_not_available,
)
from steer_by_wire.runtime.frame import EXTENDED, FD, Frame
from steer_by_wire.runtime.node import NEVER_NS, Wrapper
from steer_by_wire.tools.generate_c.law_source import law_source
from steer_by_wire.tools.generate_c.node_source import node_source
from tests.support.frames.made_messages import (
    command_of,
    error_of,
    message_with,
    motion_of,
    path_ahead_of,
)

from .law_in_c import STRICT, Target

NODE = ("steering_law.c", "node_rules.c", "crc.c", "node.c", "on_lockstep.c")


def settings_of(preset: str, *overrides: str) -> ControllerSettings:
    """Return a preset's settings, with room for every delay of drawn traffic, as C has them."""
    return controller_preset(
        preset,
        (
            *("validity.delay_ms_max=2000", "supervision.stops_if_implausible=false"),
            *overrides,
        ),
    )


def built_node(settings: ControllerSettings, folder: Path, target: Target) -> Sequence[str]:
    """Write and compile a node; returns the words that run it."""
    folder.mkdir(exist_ok=True)
    for name, text in (law_source(settings, "a test") | node_source(settings, "a test")).items():
        (folder / name).write_text(text, encoding="utf-8")
    program = folder / f"on_{target.compiler}{target.options[0]}"
    end = ["m7.c", "-lgcc"] if target.runner else ["host.c"]
    build = [target.compiler, *STRICT, *target.options, "-o", str(program), *NODE, *end]
    subprocess.run(build, cwd=folder, check=True)
    return [*target.runner, str(program)]


class RecordedNode(Wrapper[ControllerNode]):
    """The node in Python, with all that a program in lockstep would be asked in its place.

    ``name``  says which run this is

    ``asked``, ``answers``  a record of the protocol for each time that it would be woken; an
                            answer without the places that no frame takes
    """

    def __init__(self, settings: ControllerSettings, start_ns: int = 0, name: str = "") -> None:
        super().__init__(ControllerNode(settings, start_ns))
        self.name, self.frames, self.commands = name, 0, 0
        self.asked, self.answers = list[bytes](), list[bytes]()
        self._waiting: list[Arrival] = []

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        assert not self.node.on_frame(frame, now_ns)
        if self.asked and not self.finished:
            self._waiting.append((now_ns, frame))
            if len(self._waiting) == FRAMES_MAX:
                self._woken(FRAMES, now_ns, ())
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        sent = self.node.on_tick(now_ns)
        self._woken(DEADLINE if self.asked else START, now_ns, sent)
        self.frames += len(sent)
        self.commands += sum(frame.can_id == CAN_IDS[SteeringCommand] for frame in sent)
        return sent

    def _woken(self, reason: int, now_ns: int, sent: Sequence[Frame]) -> None:
        self.asked.append(pack(Record(reason, now_ns, self._waiting)))
        self._waiting = []
        next_ns = NEVER_NS if self.finished else self.deadline_ns
        answer = pack(Record(0, next_ns, [(0, frame) for frame in sent]))
        self.answers.append(answer[: len(answer) - (FRAMES_MAX - len(sent)) * FRAME_BYTES])


def answered(words: Sequence[str], runs: Sequence[RecordedNode]) -> bytes:
    """Return what a node in C answers to the same, in one process."""
    asked = b"".join(one for run in runs for one in run.asked)
    answers = subprocess.run(words, input=asked, stdout=subprocess.PIPE, check=True).stdout
    assert len(answers) == len(asked), f"{len(answers)} bytes of {len(asked)}"
    return answers


def agree(words: Sequence[str], runs: Sequence[RecordedNode]) -> None:
    """Compare a node in C; AssertionError names the first other answer."""
    answers, offset = answered(words, runs), 0
    for run in runs:
        for wanted in run.answers:
            if not answers.startswith(wanted, offset):
                answer = unpack(answers[offset : offset + RECORD_BYTES])
                expected = unpack(wanted.ljust(RECORD_BYTES, b"\0"))
                raise AssertionError(f"{run.name}: {answer}, not {expected}")
            offset += RECORD_BYTES


PERIOD_NS = 10_000_000
(
    ON_TIME,
    SILENT,
    LOSSY,
    DAMAGED,
    RESTARTED,
    FORGED,
    DOUBLED,
    LATE,
    OWN,
    FORMATS,
    OVERRUN,
    HELD_UP,
) = range(12)
"""What happens to the plant's frames, or to the node's ticks, for some periods."""
KEPT_PERIODS = 2
Segment = tuple[int, int, int]
"""Which of these, for how many periods, and a number that says how."""


class Traffic:
    """A plant's frames, period by period, with faults drawn by ``seed``, and the node's ticks."""

    def __init__(self, node: RecordedNode, start_ns: int, seed: int) -> None:
        self._node, self._now_ns, self._random = node, start_ns, random.Random(seed)
        self._messages = (LateralError, SteeringStatus, VehicleState, PathAhead)
        self._senders = {kind: Sender(kind) for kind in self._messages}
        self._others = {kind: Sender(kind) for kind in self._messages}
        self._error_m, self._speed_m_s, self._wheel_rad, self._periods = 0.1, 1.4, 0.0, 0
        self._status = SteeringStatusCode.APPLYING
        self._kept: list[Frame] = []
        node.on_tick(start_ns)

    def run(self, segment: Segment) -> None:
        """Let a segment pass."""
        kind, periods, number = segment
        self._error_m += 0.001 * (number - 128)
        if number % 5 == 0:
            self._speed_m_s = self._random.choice((0.0, 0.05, 1.2, 1.4, 1.944, 1.95, 2.5, 20.0))
        if number % 7 == 0:
            self._status = self._random.choice([*SteeringStatusCode])
        if kind == RESTARTED:
            for sender in self._senders.values():
                sender.counter = number
        for period in range(periods):
            frames = self._sent()
            if kind == OVERRUN and period < periods - 1:
                self._deliver(frames, self._now_ns + PERIOD_NS)
                continue
            if kind == HELD_UP:  # a buffer keeps the first ones, which come at the end
                self._kept += frames if period < KEPT_PERIODS else []
                frames, self._kept = ([], self._kept) if period < periods - 1 else (self._kept, [])
            self._deliver(self._struck(kind, number, frames), self._now_ns + PERIOD_NS)
            while self._node.deadline_ns <= self._now_ns and not self._node.finished:
                self._node.on_tick(self._now_ns)

    def _sent(self) -> list[Frame]:
        """Return the frames of a sample."""
        self._periods += 1
        self._error_m = max(-80.0, min(80.0, self._error_m + self._random.gauss(0.0, 0.002)))
        self._wheel_rad = max(-1.0, min(1.0, self._wheel_rad + self._random.gauss(0.0, 0.01)))
        applied = max(0, self._node.commands - 1 - self._random.randrange(4)) % COMMAND_COUNTERS
        status = self._wheel_rad, applied, self._status
        frames = [
            self._senders[LateralError].frame(
                error_of(self._error_m)._replace(heading_error_rad=0.01)
            ),
            self._senders[SteeringStatus].frame(status),
        ]
        if self._periods % 2:
            yaw_rad_s = max(-2.0, min(2.0, self._speed_m_s * self._wheel_rad / 2.8))
            frames.append(
                self._senders[VehicleState].frame(motion_of(self._speed_m_s, yaw_rad_s, 0.01))
            )
        if self._periods % 4 == 0:
            frames.append(
                self._senders[PathAhead].frame(
                    path_ahead_of([0.01] * 26, path_sample=self._periods % 256, path_spacing_m=0.5)
                )
            )
        return frames

    def _struck(self, kind: int, number: int, frames: list[Frame]) -> list[Frame]:
        """Return what arrives of them, and what else does."""
        drawn = self._random
        if kind == SILENT:
            return [frame for index, frame in enumerate(frames) if not number >> index & 1]
        if kind == LOSSY:
            return [frame for frame in frames if drawn.random() > number / 400.0]
        if kind == DAMAGED:
            return [self._damaged(frame) if drawn.random() < 0.5 else frame for frame in frames]
        if kind == FORGED and number % 4:
            other = self._others[LateralError]
            other.counter = (self._senders[LateralError].counter + number % 4 - 2) % 256
            return [*frames, other.frame(error_of(drawn.choice((self._error_m, 0.7))))]
        if kind == FORGED:
            return [*frames, *(self._others[one].frame(self._value(one)) for one in self._others)]
        if kind == DOUBLED:
            return [frame for frame in frames for _ in range(1 + (drawn.random() < 0.4))]
        if kind == LATE:
            self._kept += frames
            drawn.shuffle(self._kept)
            back, self._kept = self._kept[number % 12 :], self._kept[: number % 12]
            return back
        if kind == OWN and drawn.random() < 0.2:
            own = drawn.choice(
                (
                    Sender(SteeringCommand).frame(command_of(0.1, number)),
                    Sender(DelayStatus).frame(
                        message_with(DelayStatus, echo_delay_s=0.1, echo_state=EchoState.KNOWN)
                    ),
                )
            )
            return [*frames, own if number % 3 else self._damaged(own)]
        if kind == FORMATS:
            return [self._reshaped(frame, number) for frame in frames]
        return frames

    def _value(self, kind: type) -> tuple[Any, ...]:
        return {
            LateralError: (0.5, 0.0),
            SteeringStatus: (0.1, 5, self._status),
            VehicleState: (self._speed_m_s, 0.0, 0.0),
            PathAhead: (1, 0.5, *[0.0] * 26),
        }[kind]

    def _damaged(self, frame: Frame) -> Frame:
        data = bytearray(frame.data)
        data[self._random.randrange(len(data))] ^= 1 << self._random.randrange(8)
        return frame._replace(data=bytes(data))

    def _reshaped(self, frame: Frame, number: int) -> Frame:
        """Return a frame in another format, of another length, or without a value."""
        match number % 5:
            case 0:
                return frame._replace(flags=EXTENDED)
            case 1:
                return frame._replace(flags=FD, data=frame.data[:8] + bytes(12))
            case 2:
                return frame._replace(data=frame.data[:5], flags=0)
            case 3 if frame.can_id == CAN_IDS[LateralError]:
                counter = self._senders[LateralError].counter - 1
                return encode_not_available(error_of(), counter % 256)
        return frame._replace(can_id=frame.can_id ^ 0x30)

    def _deliver(self, frames: Sequence[Frame], end_ns: int) -> None:
        """Deliver frames evenly until ``end_ns``, which then is now."""
        begin_ns = self._now_ns
        for index, frame in enumerate(frames):
            self._node.on_frame(frame, begin_ns + (index + 1) * PERIOD_NS // (len(frames) + 1))
        self._now_ns = end_ns


def segments() -> st.SearchStrategy[list[Segment]]:
    """Draw what happens to a node, from its start on."""
    kinds = st.sampled_from((ON_TIME, *range(12)))
    one = st.tuples(kinds, st.integers(1, 60), st.integers(0, 255))
    return st.lists(one, min_size=3, max_size=25)


def driven(settings: ControllerSettings, passing: Sequence[Segment], seed: int) -> RecordedNode:
    """Let segments pass by the node in Python; returns it."""
    node = RecordedNode(settings, seed * 1000, f"{passing}, {seed}")
    traffic = Traffic(node, seed * 1000, seed)
    for segment in passing:
        if not node.finished:
            traffic.run(segment)
    return node
