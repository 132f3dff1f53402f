"""Controller and plant with authenticated frames: the same run, and nobody else has a say."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import pytest

from steer_by_wire.closed_loop.recordings.bus_listener import BusListener
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import CAN_IDS, ControllerSafety, PlantStatus, SteeringCommand
from steer_by_wire.dbc.secoc.authenticated_node import AuthenticatedNode
from steer_by_wire.dbc.secoc.authentication import Authentication
from steer_by_wire.dbc.secoc.secured_frame import Refused, plain
from steer_by_wire.plant_emulator.network.latency_distributions import Distribution
from steer_by_wire.plant_emulator.network.settings import (
    BothLatencySettings,
    LatencySettings,
    Order,
)
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.path.settings import EllipseSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import Node
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from tests.support.frames.authenticated_ends import KEY, controller, meet, plant
from tests.support.frames.decoded_frames import messages_in

OTHER_KEY = bytes(range(1, 17))
MS_NS = 1_000_000
DURATION_S = 3.0
LIMIT_NS = 5_000_000_000
ROUGH = LatencySettings(
    model=Distribution.GAMMA, mean_s=0.05, spread_s=0.03, loss=0.02, order=Order.AS_ARRIVES
)
PLANT_SETTINGS = PlantSettings(
    duration_s=DURATION_S,
    path=EllipseSettings(semi_major_axis_m=20.0, semi_minor_axis_m=10.0),
    latency=BothLatencySettings(downlink=ROUGH, uplink=ROUGH),
)
CONTROLLER_SETTINGS = controller_preset("practical_pd_ddob")


class ReceivedMessage(NamedTuple):
    time_ns: int
    sender: int
    frame: Frame


def ends(controller_key: bytes = KEY, *, run: int = 0) -> tuple[Authentication, Authentication]:
    """The two ends of a run that is not the first: other challenges, higher counters."""
    first = run * 10**9
    return (
        plant(KEY, b"plant%03d" % run, first),
        controller(controller_key, b"ctrl-%03d" % run, first),
    )


def met(run: int = 0) -> tuple[Authentication, Authentication]:
    plant_end, controller_end = ends(run=run)
    meet(controller_end, plant_end)
    return plant_end, controller_end


class Pair:
    """Both nodes in virtual time, each behind the end it is given."""

    def __init__(
        self,
        plant_end: Authentication | None,
        controller_end: Authentication | None,
    ) -> None:
        self.plant = PlantNode(PLANT_SETTINGS, 0)
        self.controller = ControllerNode(CONTROLLER_SETTINGS, 0, samples_max=10_000)
        self.plant_end = None if plant_end is None else AuthenticatedNode(self.plant, plant_end)
        self.controller_end = (
            None if controller_end is None else AuthenticatedNode(self.controller, controller_end)
        )
        self.heard: list[ReceivedMessage] = []
        nodes: list[Node] = [
            self.plant if self.plant_end is None else self.plant_end,
            self.controller if self.controller_end is None else self.controller_end,
        ]
        executor = VirtualTimeExecutor(
            nodes, None, lambda *heard: self.heard.append(ReceivedMessage(*heard))
        )
        executor.run(LIMIT_NS)

    @property
    def run(self) -> tuple[object, ...]:
        """All that the two nodes did: motion, control periods and figures."""
        return (
            tuple(map(repr, self.plant.samples)),
            tuple(map(repr, self.controller.samples)),
            repr(self.plant.report()),
            repr(self.controller.report()),
        )

    @property
    def report(self) -> Mapping[str, Any]:
        assert self.plant_end is not None
        report: Mapping[str, Any] = self.plant_end.report()["authentication"]
        return report


@pytest.fixture(scope="module")
def classic() -> Pair:
    return Pair(None, None)


@pytest.fixture(scope="module")
def authenticated() -> Pair:
    return Pair(*met())


# The same run


def test_a_pair_that_has_met_drives_the_same_run_bit_for_bit(
    classic: Pair, authenticated: Pair
) -> None:
    assert authenticated.run == classic.run
    assert len(classic.plant.samples) == round(100 * DURATION_S)
    assert authenticated.report["refused"] == {}
    as_classic = [heard._replace(frame=plain(heard.frame)) for heard in authenticated.heard]
    assert as_classic == classic.heard
    assert all(len(heard.frame.data) in (20, 48) for heard in authenticated.heard)


def test_a_pair_that_has_not_met_needs_three_status_messages_and_then_drives(classic: Pair) -> None:
    """Before, the controller does not believe the measurements, and so does not command."""
    pair = Pair(*ends())
    commands = [heard for heard in pair.heard if heard.frame.can_id == CAN_IDS[SteeringCommand]]
    assert 0 < commands[0].time_ns <= 200 * MS_NS
    assert len(pair.plant.samples) == len(classic.plant.samples)
    assert set(pair.report["refused"]) <= {Refused.UNSYNCHRONISED.value}
    assert pair.report["synchronised"]


def test_who_only_listens_reads_the_same_from_authenticated_frames(
    classic: Pair, authenticated: Pair
) -> None:
    readings = []
    for pair in (classic, authenticated):
        listener = BusListener()
        readings.append([listener.on_frame(heard.frame, 0) for heard in pair.heard])
        assert set(listener.refused) <= {"repeated"}
        assert listener.foreign_frames == 0
    assert readings[0] == readings[1]
    assert len(readings[0]) > 900


# Nobody else


def test_refusals_of_authentication_are_reported_on_the_bus_and_kept_apart_in_the_reports() -> None:
    pair = Pair(*ends(controller_key=OTHER_KEY))
    assert pair.controller_end is not None
    assert pair.plant_end is not None
    frames = [plain(heard.frame) for heard in pair.heard]
    by_controller = [message.rejected for message in messages_in(frames, ControllerSafety)]
    by_plant = [message.rejected for message in messages_in(frames, PlantStatus)]
    for rejected, modulus, end in (
        (by_controller, 4096, pair.controller_end),
        (by_plant, 32, pair.plant_end),
    ):
        # All but those since the last frame that reported them.
        assert 0 <= (sum(end.refused.values()) - rejected[-1]) % modulus < 20
        assert len(set(rejected)) > 30
        assert end.node.report()["rejected"] == {}
