"""Interventions of a tool in a run are printed, reported and traced."""

import random
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import pytest

from steer_by_wire.dbc.messages import (
    CAN_IDS,
    Direction,
    DisturbanceConfig,
    LatencyConfig,
    LatencyModel,
    LatencySet,
    PlantStatus,
)
from steer_by_wire.plant_emulator.evaluation.report_in_words import plant_summary
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from tests.support.frames.made_messages import latency_of, message_with
from tests.support.nodes.plant_link import MS_NS, PERIOD_NS, START_NS, Link, seen

GUST = message_with(
    DisturbanceConfig, side_force_n=32_767.0, steering_offset_rad=0.02, friction_loss=0.3
)
SLOW = latency_of(Direction.BOTH, 0.08, 0.03, 0.01, model=LatencyModel.NORMAL)
STATUS_ID = CAN_IDS[PlantStatus]
STATUS_ID = CAN_IDS[PlantStatus]
Changes = tuple[tuple[int, LatencyConfig | DisturbanceConfig], ...]


def driven(
    settings: PlantSettings,
    changes: Changes = (),
    forged: Mapping[int, Sequence[Frame]] = MappingProxyType({}),
    interventions: str = "allow",
) -> Link:
    """Return a run of 4 s, with changes at the given steps, 2 ms after the sample."""
    tested = Link(settings, interventions)
    by_step = dict(changes)
    for step in range(400):
        sample_ns = START_NS + step * PERIOD_NS
        if step in by_step:
            tested.configure(sample_ns + 2 * MS_NS, by_step[step])
            tested.tick(sample_ns + 2 * MS_NS)
        for frame in forged.get(step, ()):
            tested.node.on_frame(frame, sample_ns + 3 * MS_NS)
        tested.command(sample_ns + 4 * MS_NS, 0.002)
    tested.tick_until(START_NS + 400 * PERIOD_NS)
    return tested


def test_a_force_set_over_the_bus_is_shown_and_stands_in_the_report() -> None:
    node = driven(PlantSettings(), ((100, GUST),)).node
    sentence = (
        "disturbance side force 32767 N, yaw moment 0 N m, steering offset 20 mrad, friction 0.7 "
        "at 0.998 s of motion, by 324#FF7F0000C8001E (sender by DBC: TOOL)"
    )
    assert node.view(0).states["intervention"] == f"intervention 1 over the bus: {sentence}"
    assert ("intervention 1", sentence) in plant_summary(node.report())
    (kept,) = node.report()["interventions"]["kept"]
    assert kept["at_s"] == pytest.approx(0.998)
    assert (kept["side_force_n"], kept["claimed_sender"]) == (32_767.0, "TOOL")


def test_a_request_with_a_crc_acts_as_one_written_by_hand() -> None:
    by_hand, with_crc = (
        driven(PlantSettings(), ((100, message_with(kind, direction=Direction.BOTH, mean_s=0.05)),))
        for kind in (LatencyConfig, LatencySet)
    )
    assert seen(with_crc.node.samples) == seen(by_hand.node.samples)
    assert seen(with_crc.node.samples) != seen(driven(PlantSettings()).node.samples)
    (kept,) = with_crc.node.report()["interventions"]["kept"]
    assert kept["message"] == "LATENCY_SET"


def test_no_frame_of_a_tool_changes_a_plant_that_was_not_started_to_accept_them() -> None:
    rng = random.Random(58)
    plain = driven(PlantSettings())
    for _ in range(5):
        forged: dict[int, list[Frame]] = {step: [] for step in range(400)}
        for _ in range(200):
            can_id = CAN_IDS[rng.choice((LatencyConfig, DisturbanceConfig))]
            length = rng.choice((7, 7, 7, 7, rng.randrange(9)))
            data = bytes(rng.choice((0, 1, 3, 35, rng.randrange(256))) for _ in range(length))
            forged[rng.randrange(400)].append(Frame(can_id, data))
        tested = driven(PlantSettings(), forged=forged, interventions="refuse")
        # PLANT_STATUS counts what was refused; nothing else differs.
        kept = [
            [one for one in each.frames if one[1].can_id != STATUS_ID] for each in (plain, tested)
        ]
        assert kept[0] == kept[1]
        assert seen(tested.node.samples) == seen(plain.node.samples)
        report = tested.node.report()
        assert report["interventions"] == {"count": 0, "kept": []}
        assert sum(report["rejected"].values()) == 200
        assert report["rejected"]["intervention"] > 20
        said = tested.node.view(0).states["intervention"]
        assert "refused: started without --interventions" in said
