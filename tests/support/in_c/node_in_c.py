"""Drives the node in Python, keeps what it was given and sent, and compares the node in C with it.

The C runs afterwards, as one process for many runs: two processes that wait for each other, record
by record, take minutes for seconds on a busy machine.
"""

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from random import Random

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
from steer_by_wire.closed_loop.pair.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_plant
from steer_by_wire.controller.node.node import RECEIVED, ControllerNode
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.dbc.messages import CAN_IDS, SteeringCommand
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.frame import EXTENDED, FD, Frame
from steer_by_wire.runtime.node import NEVER_NS, Node, Wrapper
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from steer_by_wire.tools.generate_c.law_source import law_source
from steer_by_wire.tools.generate_c.node_source import node_source
from tests.fuzz.traffic import Sender

from .law_in_c import STRICT, Target

NODE = ("steering_law.c", "node_rules.c", "crc.c", "node.c", "on_lockstep.c", "main.c")


def settings_of(preset: str, *overrides: str) -> ControllerSettings:
    """Return a preset's settings, with room for every delay of drawn traffic, as C has them."""
    return controller_preset(
        preset,
        (*("validity.delay_ms_max=2000", "supervision.stops_if_implausible=false"), *overrides),
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


MS = 1_000_000
FAULTS: Mapping[str, float] = {
    "drop": 1.0,
    "burst_loss": 20,
    "duplicate": 0.4,
    "reorder": 3,
    "delay_spike": 0.3,
    "freeze": 1.0,
    "bit_flips": 0.02,
    "spoof": 0.2,
    "replay": 0.4,
    "out_of_range": 0.5,
}
"""What happens to the plant's frames for a while, and how much of it."""
HEARD = {CAN_IDS[kind] for kind in RECEIVED}


class Others:
    """Others on the bus: frames of ours, damaged, forged or in other formats, at any times."""

    finished = False

    def __init__(self, random: Random) -> None:
        self._random, self._sender, self.deadline_ns = random, Sender(), 100 * MS

    def on_frame(self, _frame: Frame, _now_ns: int) -> Sequence[Frame]:
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        self.deadline_ns = now_ns + self._random.choice((1, 100, 300, 1000)) * MS
        frame = self._sender.frame(self._random)
        is_heard = frame.can_id in HEARD  # by an identifier of 29 bits it would not be an own one
        flags = self._random.choice((0, 0, 0, FD, EXTENDED * is_heard))
        data = frame.data[:8] + bytes(12) * (flags == FD and len(frame.data) >= 8)
        return [Frame(frame.can_id % (1 << 11), data, flags)]


class LateTicks(Wrapper[RecordedNode]):
    """A node whose ticks are late from a time on, so that it ends."""

    late_from_ns = 5000 * MS

    @property
    def deadline_ns(self) -> int:
        deadline_ns = self.node.deadline_ns
        return deadline_ns + 15 * MS * (deadline_ns > self.late_from_ns)


def on_network(node: RecordedNode, plant: PlantSettings, *others: Node) -> None:
    """Let a node drive a plant in virtual time, among others on the bus."""
    _, edge = make_virtual_plant(plant)
    bus = BusModel(QUIET_BUS.bitrate_bit_s)
    executor = VirtualTimeExecutor((edge, LateTicks(node), *others), bus)
    executor.run(round((plant.duration_s + 0.5) * 1e9))


def drawn_run(settings: ControllerSettings, seed: int) -> RecordedNode:
    """Return a node after faults, a jittering network and others on the bus."""
    random = Random(seed)
    node = RecordedNode(settings, 0, f"run {seed}")
    faults = [
        {"kind": kind, "direction": "uplink", "magnitude": FAULTS[kind]}
        | {"message": random.choice(("LATERAL_ERROR", "STEERING_STATUS", "VEHICLE_STATE"))}
        | {"onset_s": random.uniform(0.3, 4.0), "duration_s": random.uniform(0.1, 1.5)}
        for kind in random.sample([*FAULTS], 6)
    ]
    for fault in faults:
        if fault["kind"] == "spoof":
            fault |= {"message": "LATERAL_ERROR", "signal": "lateral_error_m"}
    line = {"mean_s": random.uniform(0.0, 0.2), "spread_s": 0.02, "model": "gamma", "loss": 0.01}
    plant = PlantSettings.model_validate(
        {
            "duration_s": 6.0,
            "latency": {"uplink": line | {"order": "as_arrives"}, "downlink": line},
            "faults": faults,
            "vehicle": {"speed_m_s": random.choice((0.5, 1.4, 2.5, 20.0))},
            "path_ahead": {},
        }
    )
    others: list[Node] = [Others(random)]
    if random.random() < 0.3:
        others.append(PlantNode(plant, 2000 * MS))  # a second one, whose counters are others
    on_network(node, plant, *others)
    return node
