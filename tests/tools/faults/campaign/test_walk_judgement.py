"""What must hold for any walk of faults, checked on real runs and on made-up ones."""

from types import SimpleNamespace
from typing import Any

import pytest

from steer_by_wire.plant_emulator.faults.settings import FaultKind, FaultSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.tools.faults.campaign.campaign_file import (
    CampaignSettings,
    NodeFaultKind,
    PointSettings,
)
from steer_by_wire.tools.faults.campaign.campaign_runs import controller_settings_of
from steer_by_wire.tools.faults.campaign.detectability import Sight
from steer_by_wire.tools.faults.campaign.node_faults import NodeFault
from steer_by_wire.tools.faults.campaign.recovery import way_of
from tests.support.attacks.fault_walks import Walk, WalkFault, failure_of
from tests.support.attacks.walk_judgement import RECOVERY_S, judge_walk
from tests.support.frames.counter_rules import rule

POINT = PointSettings(name="nominal")
SPEC = CampaignSettings(laws=("practical_pd",), points=(POINT,))
END_S = 10.0


def stage_fault(kind: FaultKind, message: str, **fields: Any) -> FaultSettings:
    direction = "downlink" if message == "STEERING_COMMAND" else "uplink"
    tables = {"kind": kind, "direction": direction, "message": message, **fields}
    return FaultSettings.model_validate(tables)


FLIPS = stage_fault(FaultKind.BIT_FLIPS, "STEERING_COMMAND", duration_s=1.0, magnitude=0.02)


def said(
    *faults: NodeFault,
    stages: tuple[tuple[FaultSettings, float, float], ...] = (),
    plant: tuple[str, ...] = (),
    controller: tuple[str, ...] = (),
    abnormal: tuple[str, ...] = (),
    point: PointSettings = POINT,
    **more: Any,
) -> str:
    """Return the judgement of a run.

    ``stages``              faults with their first and last effect [s]
    ``plant, controller``   what they counted
    ``abnormal``            who is out of control at the end
    """

    def watch(name: str, counted: tuple[str, ...]) -> SimpleNamespace:
        states = [(0, False), (5 * NS_PER_S, name in abnormal)]
        fields: dict[str, Any] = {"invalid": [], "corrupted_accepted": 0, "states": states}
        fields |= more if name == "plant" else {}
        return SimpleNamespace(counted=lambda: dict.fromkeys(counted, 1), **fields)

    edge = SimpleNamespace(
        stages=[
            SimpleNamespace(
                settings=fault, first_ns=round(begin * NS_PER_S), last_ns=round(end * NS_PER_S)
            )
            for fault, begin, end in stages
        ]
    )
    pair: Any = SimpleNamespace(
        plant=watch("plant", plant),
        controller=watch("controller", controller),
        edge=edge,
        sight=Sight(0.14, 0.7, 0.01, 0.01, rule(100), rule(100)),
        way=way_of(PlantSettings(), controller_settings_of("practical_pd"), point, 0.15),
    )
    return judge_walk(pair, faults, round(END_S * NS_PER_S))


def of(kind: NodeFaultKind, node: str, onset_s: float, duration_s: float = 0.5) -> NodeFault:
    return NodeFault(kind, node, onset_s, duration_s)


def test_nothing_is_said_of_a_run_without_faults() -> None:
    assert said() == ""


def test_what_no_run_may_show_is_said() -> None:
    assert said(invalid=["wheel at 9 rad", "wheel at 9 rad"]) == "wheel at 9 rad"
    assert said(corrupted_accepted=2) == "2 corrupted frames accepted"
    assert said(states=[]) == "the plant has sent nothing"


def test_a_node_that_meets_a_detectable_fault_has_to_count_it() -> None:
    met = ((FLIPS, 2.0, 3.0),)
    assert said(stages=met) == "the plant counted nothing"
    assert said(stages=met, plant=("stale",)) == "the plant counted nothing"
    assert said(stages=met, plant=("bad_crc",)) == ""


def test_the_peer_of_a_node_that_is_away_has_to_notice_the_silence() -> None:
    for kind in (NodeFaultKind.PAUSED, NodeFaultKind.BUS_OFF):
        assert said(of(kind, "controller", 2.0)) == "the plant counted nothing"
        assert said(of(kind, "controller", 2.0), plant=("silence",)) == ""
    babbling = of(NodeFaultKind.BABBLING, "bus", 2.0)
    assert said(babbling, plant=("silence",)) == "the controller counted nothing"
    assert said(babbling, plant=("silence",), controller=("silence",)) == ""


def test_both_are_in_control_again_once_all_faults_are_over() -> None:
    over_s = END_S - RECOVERY_S
    paused = of(NodeFaultKind.PAUSED, "controller", over_s - 0.5)
    later = paused._replace(onset_s=over_s - 0.499)
    for name in ("plant", "controller"):
        again: dict[str, Any] = {"plant": ("silence",), "abnormal": (name,)}
        assert said(paused, **again) == f"the {name} is not in control again"
        assert said(later, **again) == ""


def test_the_peer_of_a_dead_node_is_out_of_control_at_the_end() -> None:
    killed = of(NodeFaultKind.KILLED, "plant", 2.0)
    counted: dict[str, Any] = {"controller": ("silence",)}
    assert said(killed, **counted) == "the controller is in control although its peer is dead"
    assert said(killed, abnormal=("controller",), **counted) == ""
    both = (killed, of(NodeFaultKind.KILLED, "controller", 4.0))
    assert said(*both, abnormal=("controller",), **counted) == ""


# Runs as they are


@pytest.mark.parametrize(
    "faults",
    [
        (of(NodeFaultKind.KILLED, "plant", 2.0), of(NodeFaultKind.PAUSED, "controller", 1.8)),
        (
            of(NodeFaultKind.CLOCK_JUMP, "controller", 3.0)._replace(magnitude=0.3),
            of(NodeFaultKind.CLOCK_JUMP, "controller", 2.0)._replace(magnitude=4.0),
            of(NodeFaultKind.BUS_OFF, "plant", 2.9),
        ),
        (FLIPS, of(NodeFaultKind.PAUSED, "plant", 0.5)),
    ],
)
def test_the_pair_stands_faults_of_nodes_that_overlap(faults: tuple[WalkFault, ...]) -> None:
    assert failure_of(SPEC, Walk(1, POINT, "practical_pd", faults)) == ""
