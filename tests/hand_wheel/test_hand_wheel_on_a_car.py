"""A hand wheel on a bus that speaks a car's dialect, and next to authenticated frames."""

from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_nodes
from steer_by_wire.closed_loop.pair.with_hand_wheel import with_hand_wheel
from steer_by_wire.closed_loop.scripting.simulate import settings_of
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.bus_language import read_language
from steer_by_wire.dbc.secoc.authenticated_node import AuthenticatedNode
from steer_by_wire.dbc.secoc.authentication import Authentication
from steer_by_wire.dbc.secoc.key_file import cmac_maker
from steer_by_wire.dbc.secoc.secured_frame import STATUS_SENT_BY, plain
from steer_by_wire.hand_wheel.__main__ import main
from steer_by_wire.hand_wheel.node import HandWheelNode
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import Node
from steer_by_wire.runtime.node.end import End
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from tests.support.frames.authenticated_ends import (
    CONTROLLER_STATUS,
    HAND_WHEEL_STATUS,
    KEY,
    PLANT_STATUS,
    flipped,
)

CAR = Path(__file__).parents[1] / "dbc" / "dialect" / "my_car.toml"
NAMES, STATUSES = tuple(STATUS_SENT_BY), (PLANT_STATUS, CONTROLLER_STATUS, HAND_WHEEL_STATUS)
KEPT = ("STEERING_FORCE", "HAND_WHEEL_STATE", "HAND_WHEEL_FEEDBACK", "HAND_WHEEL_STATUS")


def test_three_nodes_behind_gateways_drive_and_feel(tmp_path: Path) -> None:
    file = tmp_path / "car.toml"
    text = CAR.read_text().replace('"my_car.dbc"', f'"{CAR.parent / "my_car.dbc"}"', 1)
    file.write_text(f"keep = {[*KEPT]}\n{text}")
    language = read_language(file)
    kick = {"at_s": 0.5, "lasts_s": 1.0, "torque_n_m": 1.0}
    wheel = HandWheelSettings.model_validate({"driver": {"grip": "loose", "kicks": [kick]}})
    plant, law, wheel = with_hand_wheel(
        plant_preset("paper_nominal", ["duration_s=2", 'path={kind="straight"}']),
        controller_preset("practical_pd", ["hand_wheel.steered_by=driver"]),
        wheel,
    )
    node = HandWheelNode(wheel, 0)
    ends = (PlantNode(plant, 0), End.PLANT), (ControllerNode(law, 0), End.CONTROLLER), (node, None)
    edges = [language.at_edge(each, end, 0) for each, end in ends]
    run_virtual_nodes(edges[0], edges[1], None, None, lambda: False, others=edges[2:])
    report = edges[2].report()
    assert report["steered_by"] == "driver"
    assert report["mode"] == "active"  # the force came through
    assert report["dialect"]["sent"] == 0
    assert report["dialect"]["accepted"] > 50  # angle of the road wheels
    assert report["second_senders"] == []
    assert edges[0].report()["peak_m"] > 0.01


def test_a_dialect_without_its_messages_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--dialect", str(CAR)]) == ExitStatus.SETTINGS
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{CAR}: keep lacks {', '.join(KEPT)}, which no signal" in line


class Intruder:
    """Repeats each millisecond what it has heard, or cuts it, flips a bit, or leaves out the code.

    ``heard``  of a run before
    """

    finished = False

    def __init__(self, heard: Sequence[Frame]) -> None:
        self.random, self.heard, self.sent = Random(len(heard)), [*heard], 0

    @property
    def deadline_ns(self) -> int:
        return 1_000_000 * self.sent + 100

    def on_frame(self, frame: Frame, _now_ns: int) -> tuple[Frame, ...]:
        self.heard.append(frame)
        return ()

    def on_tick(self, _now_ns: int) -> tuple[Frame, ...]:
        self.sent += 1
        frame = self.random.choice(self.heard[-self.random.choice((3, 30, 30_000)) :])
        flip = flipped(frame, self.random.randrange(8 * len(frame.data)))
        short = frame._replace(data=frame.data[: self.random.randrange(len(frame.data))])
        return (self.random.choice((frame, flip, short, plain(frame))),)


def met(run: int) -> list[Authentication]:
    """Return the ends of plant, controller and hand wheel after they have met."""
    ends = [
        Authentication([one for one in NAMES if one != own], cmac_maker()(KEY), challenge, run)
        for own, challenge in ((name, f"{run:07}{name[0]}".encode()) for name in NAMES)
    ]
    for status, end in 3 * [*zip(STATUSES, ends, strict=True)]:
        frame = end.secure(status)
        for other in ends:
            other.verify(frame)
    return ends


def drive(ends: Sequence[Authentication] = (), others: Sequence[Node] = ()) -> tuple[Any, Any]:
    """Return three nodes after two seconds, and as they are on the bus."""
    plant, law, wheel = with_hand_wheel(
        plant_preset("paper_nominal", ["duration_s=2"]),
        controller_preset("practical_pd", ["hand_wheel.hand_back_s=0.5"]),
        settings_of(HandWheelSettings, "two_point", {}),
    )
    nodes = PlantNode(plant, 0), ControllerNode(law, 0, 9999), HandWheelNode(wheel, 0, 9999)
    edges = [AuthenticatedNode(*each) for each in zip(nodes, ends, strict=True)] if ends else nodes
    VirtualTimeExecutor([*edges, *others]).run(5_000_000_000)
    return nodes, edges


def test_three_nodes_with_a_key_accept_nothing_of_an_intruder() -> None:
    (classic, _), heard = drive(), list[Frame]()
    for run in (0, 10**6):
        intruder = Intruder(heard)
        keyed, edges = drive(met(run), [intruder])
        for one, other in zip(classic, keyed, strict=True):
            assert list(map(repr, one.samples)) == list(map(repr, other.samples))
        assert intruder.sent > 1900
        for edge in edges:
            assert edge.report()["authentication"]["synchronised"]
            assert sum(edge.refused.values()) == intruder.sent
        heard = intruder.heard
