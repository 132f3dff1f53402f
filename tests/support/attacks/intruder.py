"""An intruder without a key who hears every frame, and chooses each counter and time of his own."""

import heapq
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    NUMBERED_WITH,
    Decoded,
    LateralError,
    Message,
    Mode,
    SteeringCommand,
    SteeringPlan,
    decode,
    encode,
)
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.steering.plan_buffer import PLAN_VALUES
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NEVER_NS, NS_PER_S, Node
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor

from .forged_counters import Shot


class Attack(NamedTuple):
    """What is forged, from when on and for how long.

    ``shots``    behind each true frame, in turn; none: the message does not arrive instead
    ``repeats``  whether they begin again after the last
    """

    kind: type[Message]
    value: float
    onset_ns: int
    lasts_ns: int
    shots: Sequence[Sequence[Shot]] = ()
    repeats: bool = True

    def forged(self, counter: int, like: Message) -> Frame:
        """Return an intact forged frame; beside true plans, half of them are plans.

        ``like``  the newest true one
        """
        if self.kind is LateralError:
            return encode(LateralError(self.value, 0.0), counter % 256)
        if isinstance(like, SteeringPlan) and counter % 2:
            plan = SteeringPlan(*like[:-PLAN_VALUES], *(PLAN_VALUES * [self.value]))
            return encode(plan, counter % 256)
        return encode(SteeringCommand(self.value, counter % 65_536, Mode.ACTIVE), counter % 256)

    def lasts(self, frame: Frame, now_ns: int) -> bool:
        """Whether a frame is of the message, or in its place, and comes during the attack."""
        is_now = self.onset_ns <= now_ns < self.onset_ns + self.lasts_ns
        kinds = (self.kind, *(one for one, it in NUMBERED_WITH.items() if it is self.kind))
        return is_now and frame.can_id in {CAN_IDS[kind] for kind in kinds}


class Intruder:
    """A node that attacks."""

    finished = False

    def __init__(self, attack: Attack) -> None:
        self._attack = attack
        self._heard = 0
        self._waiting: list[tuple[int, int, int]] = []
        self._newest: Message = LateralError(0.0, 0.0)

    @property
    def deadline_ns(self) -> int:
        return self._waiting[0][0] if self._waiting else NEVER_NS

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        shots = self._attack.shots
        if self._attack.lasts(frame, now_ns):
            decoded = decode(frame)
            assert isinstance(decoded, Decoded)
            self._newest = decoded.message
            if self._attack.repeats or self._heard < len(shots):
                for order, (after_ns, ahead) in enumerate(shots[self._heard % len(shots)]):
                    entry = (now_ns + after_ns, order, decoded.counter + ahead)
                    heapq.heappush(self._waiting, entry)
            self._heard += 1
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        frames = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            _, _, counter = heapq.heappop(self._waiting)
            frames.append(self._attack.forged(counter, self._newest))
        return frames


class Deaf:
    """A node that does not get a message for as long as an attack would last."""

    def __init__(self, node: Node, attack: Attack) -> None:
        self._node, self._attack = node, attack

    @property
    def deadline_ns(self) -> int:
        return self._node.deadline_ns

    @property
    def finished(self) -> bool:
        return self._node.finished

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        return () if self._attack.lasts(frame, now_ns) else self._node.on_frame(frame, now_ns)

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        return self._node.on_tick(now_ns)


class Run(NamedTuple):
    """The frames on the bus with their times, and both reports."""

    frames: Sequence[tuple[int, Frame]]
    plant: Mapping[str, Any]
    controller: Mapping[str, Any]

    @property
    def peak_m(self) -> float:
        return float(self.plant["lateral_error_peak_m"])


def drive(
    plant: PlantSettings, controller: ControllerSettings, attack: Attack | None = None
) -> Run:
    """Run the pair in virtual time, alone or under an attack."""
    pair = make_virtual_pair(plant, controller)
    nodes: list[Node] = [pair.plant, pair.controller]
    if attack is not None and attack.shots:
        nodes.append(Intruder(attack))
    elif attack is not None:
        nodes = [Deaf(node, attack) for node in nodes]
    frames: list[tuple[int, Frame]] = []
    executor = VirtualTimeExecutor(
        nodes, None, lambda time_ns, _, frame: frames.append((time_ns, frame))
    )
    executor.run(round((plant.duration_s + 5.0) * NS_PER_S))
    return Run(frames, pair.plant.report(), pair.controller.report())
