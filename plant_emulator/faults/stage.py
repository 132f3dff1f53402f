"""The fault stage at the plant, through which all its frames pass.

    bus ── downlink faults ──► node ── uplink faults ──► bus

Each fault of the settings is one stage, in their order; the output of one is the input of the next.
Frames held by a delay spike are passed on when they are due, and skip the faults after it. Every
fault draws from its own stream, so that it does not change the draws of other faults, latency or
noise: until the first onset a run is the same as without faults, bit for bit.

Onsets count from the first command or plan that arrives, with which the motion starts.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ...runtime.frame import Frame
from ...runtime.node import NEVER_NS, NS_PER_S, N, Wrapper
from ..network.random_streams import Stream, uniforms
from .effects import EFFECTS, FaultMemory, overtake
from .messages_on_bus import OURS, MessagesOnBus
from .settings import STEERING_FAULTS, FaultDirection, FaultKind, FaultSettings


class FaultStage:
    """One fault.

    ``place``     in the list of faults; selects the random stream
    ``changed``   frames so far that were lost, changed, delayed or joined by others
    """

    def __init__(
        self, settings: FaultSettings, seed: int, place: int, messages: MessagesOnBus = OURS
    ) -> None:
        self.settings = settings
        self._effect = EFFECTS[settings.kind]
        self._ids = messages.ids(settings)
        self._memory = FaultMemory(uniforms(seed, Stream.FAULTS, place), messages)
        self._records = settings.kind is FaultKind.REPLAY
        self._onset_ns = round(settings.onset_s * NS_PER_S)
        self._end_ns = self._onset_ns + round(settings.duration_s * NS_PER_S)
        self.changed = 0
        self.first_ns: int | None = None
        self.last_ns: int | None = None

    @property
    def next_due_ns(self) -> int:
        """When the next delayed frame is due [ns]; NEVER_NS if there is none."""
        delayed = self._memory.delayed
        return delayed[0][0] if delayed else NEVER_NS

    def pass_on(self, frame: Frame, now_ns: int, since_ns: int) -> Sequence[Frame]:
        """Return the frames passed on for one that comes ``since_ns`` after the clock's start."""
        if frame.can_id not in self._ids:
            return (frame,)
        memory = self._memory
        if self._records:
            memory.recorded.append((now_ns, frame))
            self._forget(now_ns)
        out: Sequence[Frame] = (frame,)
        if self._onset_ns <= since_ns < self._end_ns or memory.burst:
            memory.now_ns, memory.since_onset_s = now_ns, (since_ns - self._onset_ns) / NS_PER_S
            out = self._effect(self.settings, memory, frame)
            if tuple(out) != (frame,):
                self.changed += 1
                self.first_ns = now_ns if self.first_ns is None else self.first_ns
                self.last_ns = now_ns
        elif since_ns < self._onset_ns:
            memory.before[frame.can_id] = frame
        if memory.held and out:
            return [*out, *(late for one in out for late in overtake(memory, one))]
        return out

    def pop_due(self, now_ns: int) -> list[Frame]:
        """Return the delayed frames that are due."""
        delayed, due = self._memory.delayed, []
        while delayed and delayed[0][0] <= now_ns:
            self.last_ns, frame = delayed.popleft()
            due.append(frame)
        return due

    def report(self) -> Mapping[str, Any]:
        """Return its figures, ready for JSON; times in seconds of the run's clock."""
        return {
            "kind": self.settings.kind.value,
            "direction": self.settings.direction.value,
            "message": self.settings.message,
            "changed": self.changed,
            "first_s": None if self.first_ns is None else self.first_ns / NS_PER_S,
            "last_s": None if self.last_ns is None else self.last_ns / NS_PER_S,
        }

    def _forget(self, now_ns: int) -> None:
        """Drop recorded frames, except the newest of each identifier that is old enough."""
        recorded = self._memory.recorded
        oldest_ns = now_ns - round(self.settings.magnitude * NS_PER_S) - NS_PER_S
        while recorded and recorded[0][0] < oldest_ns:
            recorded.popleft()


class FaultyNode(Wrapper[N]):
    """Runs ``node`` with faults of its frames, of both directions, each a stage in their order."""

    def __init__(
        self, node: N, faults: Sequence[FaultSettings], seed: int, messages: MessagesOnBus = OURS
    ) -> None:
        super().__init__(node)
        self._messages = messages
        self.stages = [
            FaultStage(fault, seed, place, messages)
            for place, fault in enumerate(faults)
            if fault.kind not in STEERING_FAULTS
        ]
        self._down, self._up = (
            [stage for stage in self.stages if stage.settings.direction is direction]
            for direction in (FaultDirection.DOWNLINK, FaultDirection.UPLINK)
        )
        self._start_ns: int | None = None

    @property
    def deadline_ns(self) -> int:
        """When the node's next tick or a delayed frame is due [ns]."""
        return min([self.node.deadline_ns, *(stage.next_due_ns for stage in self.stages)])

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Pass a frame to the node through the downlink's faults."""
        if self._start_ns is None and self._messages.starts(frame, now_ns):
            self._start_ns = now_ns
        return self._hand_in(self._through(self._down, [frame], now_ns), now_ns)

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Pass on delayed frames that are due, and let the node tick."""
        late = [frame for stage in self._down for frame in stage.pop_due(now_ns)]
        sent = [*self._hand_in(late, now_ns)]
        for stage in self._up:
            sent += stage.pop_due(now_ns)
        if self.node.deadline_ns <= now_ns:
            sent += self._through(self._up, self.node.on_tick(now_ns), now_ns)
        return sent

    def report(self) -> Mapping[str, Any]:
        """Return the node's report, with the figures of each fault under ``faults``."""
        return {**self.node.report(), "faults": [stage.report() for stage in self.stages]}

    def _hand_in(self, frames: Iterable[Frame], now_ns: int) -> Sequence[Frame]:
        answers = [answer for frame in frames for answer in self.node.on_frame(frame, now_ns)]
        return self._through(self._up, answers, now_ns)

    def _through(
        self, stages: Sequence[FaultStage], frames: Sequence[Frame], now_ns: int
    ) -> Sequence[Frame]:
        if self._start_ns is None:
            return frames
        since_ns = now_ns - self._start_ns
        for stage in stages:
            frames = [out for frame in frames for out in stage.pass_on(frame, now_ns, since_ns)]
        return frames


def with_faults(
    node: N, faults: Sequence[FaultSettings], seed: int, messages: MessagesOnBus = OURS
) -> N | FaultyNode[N]:
    """Return the node behind the faults of its frames; the node itself if there are none."""
    if all(fault.kind in STEERING_FAULTS for fault in faults):
        return node
    return FaultyNode(node, faults, seed, messages)
