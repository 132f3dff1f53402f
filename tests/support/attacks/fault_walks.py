"""Random walks: sequences of faults that may overlap, drawn and shortened by hypothesis.

A walk has up to six faults of a campaign's specification, of the stage at the plant's edge and of
whole nodes, with random onsets and durations. ``walk_judgement`` defines what must hold for all of
them. Each fault draws from its own random stream, so that those that remain in a shorter walk do
the same as before.
"""

from collections.abc import Sequence
from typing import NamedTuple

from hypothesis import strategies as st

from steer_by_wire.plant_emulator.faults.settings import FaultKind, FaultSettings
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.tools.faults.campaign.campaign_file import (
    CampaignSettings,
    CaseSettings,
    NodeCaseSettings,
    NodeFaultKind,
    PointSettings,
    direction_of,
)
from steer_by_wire.tools.faults.campaign.campaign_runs import (
    FaultCase,
    Scenario,
    laws_of,
    scenario_sight,
)
from steer_by_wire.tools.faults.campaign.detectability import Expectation, Sight, period_s_of
from steer_by_wire.tools.faults.campaign.node_faults import NodeFault
from steer_by_wire.tools.faults.campaign.watched_pair import make_pair, run_pair
from tests.support.attacks.walk_judgement import RECOVERY_S, judge_walk

WALK_FAULTS_MAX = 6
FIRST_MS, LAST_MS = 1000, 5000
"""When the faults of a walk may begin."""
DURATION_MS_MAX = 1500
MOTION_S = 1e-3 * (LAST_MS + DURATION_MS_MAX) + RECOVERY_S
"""Where no fault outlasts its end."""
WalkFault = FaultSettings | NodeFault


class Walk(NamedTuple):
    """A sequence of faults at an operating point."""

    seed: int
    point: PointSettings
    law: str
    faults: tuple[WalkFault, ...]


@st.composite
def walks(draw: st.DrawFn, spec: CampaignSettings) -> Walk:
    """Draw a walk; at most one of its faults is a babbling node."""
    faults: list[WalkFault] = []
    tables: Sequence[CaseSettings | NodeCaseSettings] = (*spec.cases, *spec.node_cases)
    for place in range(draw(st.integers(1, WALK_FAULTS_MAX))):
        if not tables:
            break
        fault = draw(walk_faults(draw(st.sampled_from(tables)), place))
        faults.append(fault)
        if fault.kind is NodeFaultKind.BABBLING:  # a second one would find no room on the bus
            tables = [table for table in tables if table.kind is not NodeFaultKind.BABBLING]
    point = draw(st.sampled_from(spec.points))
    law = draw(st.sampled_from(laws_of(spec, point)))
    return Walk(draw(st.integers(1, 2**31)), point, law, tuple(faults))


@st.composite
def walk_faults(draw: st.DrawFn, table: CaseSettings | NodeCaseSettings, place: int) -> WalkFault:
    """Draw a fault of a table; ``place`` is its place in the walk."""
    onset_s = 1e-3 * draw(st.integers(FIRST_MS, LAST_MS))
    duration_s = 1e-3 * draw(st.integers(20, DURATION_MS_MAX))
    magnitude = draw(st.sampled_from(table.magnitudes))
    if isinstance(table, NodeCaseSettings):
        node = draw(st.sampled_from(table.nodes))
        return NodeFault(table.kind, node, onset_s, duration_s, magnitude)
    message = draw(st.sampled_from(table.messages))
    return FaultSettings(
        kind=table.kind,
        direction=direction_of(message),
        message=message,
        signal=table.signal_of(message),
        onset_s=onset_s,
        duration_s=duration_s,
        magnitude=magnitude,
        stream=place,
    )


def failure_of(spec: CampaignSettings, walk: Walk) -> str:
    """Run a walk; returns why it fails, empty where it does not."""
    stage = tuple(fault for fault in walk.faults if isinstance(fault, FaultSettings))
    nodes = [fault for fault in walk.faults if isinstance(fault, NodeFault)]
    sight = scenario_sight(spec, walk.point, walk.law)
    motion_s = max([MOTION_S, *(_over_s(fault, sight) + RECOVERY_S for fault in stage)])
    longer = spec.model_copy(update={"motion_s": motion_s})
    case = FaultCase("walk", "", 0.0, "both", Expectation((), False, "walk"), stage)
    scenario = Scenario(case, walk.point, walk.law, walk.seed, longer)
    pair = make_pair(scenario, nodes)
    run_pair(scenario, pair)
    return judge_walk(pair, nodes, round(motion_s * NS_PER_S))


def _over_s(fault: FaultSettings, sight: Sight) -> float:
    """Return from when a fault of the stage has no effect [s]."""
    end_s = fault.onset_s + fault.duration_s
    if fault.kind is FaultKind.BURST_LOSS:
        return end_s + fault.magnitude * period_s_of(fault, sight)
    return end_s + fault.magnitude if fault.kind is FaultKind.DELAY_SPIKE else end_s
