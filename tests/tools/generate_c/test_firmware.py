"""The node in C sends the frames of the node in Python; ``tests.soak.node_in_c`` looks longer."""

import random
from collections.abc import Sequence

import pytest

from steer_by_wire.closed_loop.pair.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_plant, run_virtual_nodes
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.quiet_bus import QuietBus
from tests.support.in_c.law_in_c import hosts
from tests.support.in_c.node_in_c import (
    OVERRUN,
    RecordedNode,
    agree,
    built_node,
    driven,
    settings_of,
)

SETTINGS = settings_of("practical_pd_ddob", "overruns.overruns_max=3")
JITTERING = {
    "duration_s": 2.0,
    "sensor_noise": {"lateral_error_m": 0.002},
    "latency": {
        "downlink": {"mean_s": 0.05},
        "uplink": {"mean_s": 0.02, "spread_s": 0.01, "model": "normal", "loss": 0.01},
    },
}


@pytest.fixture(scope="module")
def in_c(tmp_path_factory: pytest.TempPathFactory) -> Sequence[str]:
    """The words that run a node in C, which every start makes new."""
    return built_node(SETTINGS, tmp_path_factory.mktemp("node"), hosts()[0])


def test_on_a_network_with_jitter(in_c: Sequence[str]) -> None:
    _, edge = make_virtual_plant(PlantSettings.model_validate(JITTERING))
    node = RecordedNode(SETTINGS)
    run_virtual_nodes(edge, node, QuietBus(QUIET_BUS.bitrate_bit_s), None, lambda: False)
    agree(in_c, [node])
    assert node.commands > 150


def test_through_all_that_happens_to_frames(in_c: Sequence[str]) -> None:
    drawn, nodes = random.Random(1), list[RecordedNode]()
    for seed in range(10):
        kinds = [kind for kind in drawn.sample(range(12), 12) if kind != OVERRUN]
        kinds += [OVERRUN] * 5
        passing = [(kind, drawn.randint(2, 25), drawn.randrange(256)) for kind in kinds]
        nodes.append(driven(SETTINGS, passing, seed))
    agree(in_c, nodes)
    causes = {cause for node in nodes for cause in node.report()["rejected"]}
    assert {"bad_crc", "own_identifier", "no_key", "not_available", "too_far"} <= causes
    assert any(node.report()["failure"] for node in nodes)
