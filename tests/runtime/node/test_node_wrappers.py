"""Wrappers of a node pass on every call to the node, except those that they exist to change."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pytest

from steer_by_wire.dbc.messages import PlantStatus, encode
from steer_by_wire.dbc.secoc.authenticated_node import AuthenticatedNode
from steer_by_wire.plant_emulator.faults.settings import FaultKind, FaultSettings
from steer_by_wire.plant_emulator.faults.stage import FaultyNode, with_faults
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import Node, ReportingNode, View, Wrapper
from tests.support.frames.authenticated_ends import COMMAND, plant
from tests.support.frames.made_messages import message_with
from tests.support.nodes.plant_link import START_NS

LATER_NS = 9_000_000_000
DROP = FaultSettings(
    kind=FaultKind.DROP, direction="downlink", message="STEERING_COMMAND", onset_s=50.0, magnitude=1
)


class Asked:
    """A node that notes what it is asked."""

    deadline_ns = LATER_NS
    finished = True

    def __init__(self) -> None:
        self.calls: list[tuple[object, ...]] = []

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        self.calls.append((frame, now_ns))
        return (COMMAND,)

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        self.calls.append((now_ns,))
        return (COMMAND,)

    def on_unauthenticated(self) -> None:
        self.calls.append(())

    def view(self, now_ns: int) -> View:
        return View({}, {}, str(now_ns))

    def report(self) -> Mapping[str, Any]:
        counts = {"skipped_ticks": 0, "law_failures": 0, "holds": 0, "lost": 0, "failure": ""}
        stale = {"steering_status": 0, "vehicle_state": 0}
        return {**counts, "rejected": {}, "stale": stale, "accepted": 0, "seen": len(self.calls)}


WRAPPERS: dict[str, Callable[[Asked], Wrapper[Any]]] = {
    "bare": Wrapper,
    "faulty": lambda node: FaultyNode(node, [DROP], 1),
}


@pytest.mark.parametrize("wrapped", WRAPPERS.values(), ids=WRAPPERS)
def test_a_wrapper_with_nothing_to_do_is_as_its_node(
    wrapped: Callable[[Asked], Wrapper[Any]],
) -> None:
    node = Asked()
    wrapper = wrapped(node)
    assert (wrapper.deadline_ns, wrapper.finished) == (LATER_NS, True)
    assert tuple(wrapper.on_frame(COMMAND, 5)) == (COMMAND,)
    wrapper.on_unauthenticated()
    assert tuple(wrapper.on_tick(LATER_NS)) == (COMMAND,)
    assert node.calls == [(COMMAND, 5), (), (LATER_NS,)]
    assert wrapper.report()["seen"] == 3
    assert wrapper.view(7).now == "7"


def test_the_base_of_all_wrappers_has_every_part_of_the_protocol() -> None:
    """The protocol's own bodies are empty: what the base lacks would silently do nothing."""
    parts = {name for name in (*vars(Node), *vars(ReportingNode)) if not name.startswith("_")}
    assert {"deadline_ns", "on_unauthenticated"} < parts <= set(vars(Wrapper))


def test_an_authenticated_plant_with_a_fault_counts_a_classic_frame() -> None:
    """It was the end of the program, by a traceback."""
    rig = PlantNode(PlantSettings(), START_NS)
    node = AuthenticatedNode(with_faults(rig, [DROP], 1), plant())
    assert node.on_frame(COMMAND, START_NS) == ()
    assert node.report()["authentication"]["refused"] == {"unauthenticated": 1}
    assert encode(message_with(PlantStatus, rejected=1), 0) in rig.on_tick(START_NS)
