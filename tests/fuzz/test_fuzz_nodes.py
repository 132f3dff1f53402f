"""Memory of a node does not grow with what it receives, and a stall of an hour ends."""

from collections.abc import Callable, Iterable
from random import Random
from typing import Any

import pytest

from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.dbc.messages import Direction, encode
from steer_by_wire.plant_emulator.faults.settings import FaultKind, FaultSettings
from steer_by_wire.plant_emulator.faults.stage import FaultyNode
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S, ReportingNode
from tests.fuzz.node_targets import controller_settings, plant_settings
from tests.fuzz.traffic import Sender
from tests.support.frames.made_messages import latency_of

PERIOD_NS = 10 * NS_PER_MS
OUR_MODULES = "steer_by_wire."
SIMPLE = {float, int, bool, str, bytes, type(None)}
"""Kinds that hold nothing, which most items are."""


def make_controller(number: int) -> ControllerNode:
    return ControllerNode(controller_settings(number), 0)


def make_plant(number: int) -> PlantNode:
    settings, params = plant_settings(number)
    return PlantNode(settings, 0, params, samples_max=0)


def make_faulty(_number: int) -> FaultyNode[PlantNode]:
    """A plant behind the faults for which a stage keeps frames."""
    kinds = {FaultKind.REPLAY: 1.0, FaultKind.REORDER: 3.0, FaultKind.DELAY_SPIKE: 0.3}
    faults = [
        FaultSettings(kind=kind, direction="downlink", onset_s=0.0, magnitude=magnitude)
        for kind, magnitude in kinds.items()
    ]
    return FaultyNode(make_plant(0), faults, 1)


def entries(root: object) -> int:
    """Count what lies in containers that a node holds, however deep."""
    seen: set[int] = set()
    waiting: list[Any] = [root]
    count = 0
    while waiting:
        item = waiting.pop()
        if id(item) in seen:
            continue
        seen.add(id(item))
        if isinstance(item, dict):
            count += len(item)
            waiting += [*item.keys(), *item.values()]
        elif isinstance(item, list | tuple | set | frozenset) or type(item).__name__ == "deque":
            count += len(item)
            waiting += [one for one in item if type(one) not in SIMPLE]
        elif type(item).__module__.startswith(OUR_MODULES):
            waiting += members(item)
    return count


def members(item: object) -> Iterable[Any]:
    slots = [name for kind in type(item).__mro__ for name in getattr(kind, "__slots__", ())]
    return [
        *getattr(item, "__dict__", {}).values(),
        *(getattr(item, name) for name in slots if hasattr(item, name)),
    ]


def send_garbage(node: ReportingNode, seed: int, frames: int, start_ns: int) -> int:
    """Send frames of every kind, one in a period; returns the time at the end [ns]."""
    random, sender = Random(seed), Sender()
    now_ns = start_ns
    for _ in range(frames):
        now_ns += PERIOD_NS
        node.on_frame(sender.frame(random), now_ns)
        if node.deadline_ns <= now_ns:
            node.on_tick(now_ns)
    return now_ns


def drain(node: ReportingNode, now_ns: int) -> int:
    """Let what waits in a plant's latency lines leave; returns the time at the end [ns]."""
    none = latency_of(Direction.BOTH)
    node.on_frame(encode(none, 0), now_ns)
    for _ in range(20):
        now_ns += NS_PER_S
        node.on_tick(now_ns)
    return now_ns


@pytest.mark.parametrize(
    ("make", "number", "margin"),
    [
        # A few bins of statistics more with every power of two.
        (make_controller, 0, 300),
        (make_controller, 6, 300),
        # Its lines have statistics of their latencies too.
        (make_plant, 3, 3_000),
        (make_faulty, 0, 3_000),
    ],
)
def test_what_a_node_keeps_does_not_grow_with_garbage(
    make: Callable[[int], ReportingNode], number: int, margin: int
) -> None:
    node = make(number)
    # So long that the record of the last seconds, and the list of interventions, are full.
    now_ns = drain(node, send_garbage(node, 1, 3_600, 0))
    settled = entries(node)
    drain(node, send_garbage(node, 2, 1_200, now_ns))
    assert entries(node) < settled + margin


def test_what_grows_would_be_noticed() -> None:
    node = make_controller(0)
    before = entries(node)
    node.__dict__["kept"] = [object() for _ in range(3_000)]
    assert entries(node) >= before + 3_000
