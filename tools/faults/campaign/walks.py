"""Random walks: seeded sequences of faults that overlap, and the shortest one that still fails.

A walk draws two to six faults of the specification, of the stage at the plant's edge and of whole
nodes, when each begins and how long it lasts. ``walk_judgement`` defines what must hold for all of
them. Of a failing walk every part is tried, smaller ones first, until one fails too. Each fault
draws from its own random stream, so that the remaining ones do the same as before.
"""

import json
import random
from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations
from typing import NamedTuple, TypeVar

from ....plant_emulator.faults.settings import FaultKind, FaultSettings
from ....runtime.node import NS_PER_S
from ....runtime.settings import SettingsError
from .detectability import Expectation, Sight, period_s_of
from .execution import execute
from .node_faults import NodeFault
from .scenario import Case, Scenario, laws_of, scenario_sight
from .specification import (
    CampaignSettings,
    CaseSettings,
    NodeCaseSettings,
    NodeFaultKind,
    PointSettings,
    direction_of,
)
from .walk_judgement import RECOVERY_S, judge_walk
from .watched_pair import make_pair, run_pair

WALK_FAULTS_MAX = 6
FIRST_S, LAST_S = 1.0, 5.0
"""When the faults of a walk may begin."""
DURATION_S_MAX = 1.5
MOTION_S = LAST_S + DURATION_S_MAX + RECOVERY_S
"""Where no fault outlasts its end."""
_WALK = "walk"
WalkFault = FaultSettings | NodeFault
T = TypeVar("T")


class Walk(NamedTuple):
    """A sequence of faults and, if it fails, why, and its shortest part that fails too.

    ``shortest``          empty for a run that fails without any fault
    ``shortest_failure``  why the shortest fails, which need not be why the whole does
    """

    seed: int
    point: PointSettings
    law: str
    faults: tuple[WalkFault, ...]
    failure: str = ""
    shortest: tuple[WalkFault, ...] = ()
    shortest_failure: str = ""


def walk_all(
    spec: CampaignSettings, count: int, processes: int, take: Callable[[Walk], None]
) -> None:
    """Do ``count`` walks; ``take`` gets each when it is done, which may be in any order."""
    execute(partial(one_walk, spec), range(spec.seed, spec.seed + count), processes, take)


def one_walk(spec: CampaignSettings, seed: int) -> Walk:
    """Draw one walk, run it and, if it fails, shorten it."""
    walk = draw_walk(spec, seed)
    failure = failure_of(spec, walk, walk.faults)
    if not failure:
        return walk
    shortest, why = shorten(walk.faults, partial(failure_of, spec, walk)) or (walk.faults, failure)
    return walk._replace(failure=failure, shortest=shortest, shortest_failure=why)


def draw_walk(spec: CampaignSettings, seed: int) -> Walk:
    """Draw the faults of a walk, its operating point and its law; the same for the same seed."""
    draw = random.Random(seed)  # noqa: S311 no secret
    faults: list[WalkFault] = []
    tables: Sequence[CaseSettings | NodeCaseSettings] = (*spec.cases, *spec.node_cases)
    for place in range(draw.randint(2, WALK_FAULTS_MAX)):
        if not tables:
            break
        fault = _draw_fault(draw.choice(tables), draw, place)
        faults.append(fault)
        if fault.kind is NodeFaultKind.BABBLING:  # a second one would find no room on the bus
            tables = [table for table in tables if table.kind is not NodeFaultKind.BABBLING]
    point = draw.choice(spec.points)
    return Walk(seed, point, draw.choice(laws_of(spec, point)), tuple(faults))


def shorten(
    faults: Sequence[T], failure_of: Callable[[Sequence[T]], str]
) -> tuple[tuple[T, ...], str] | None:
    """Return the first of the shortest proper parts that fail, in their order, and why it does.

    None where only the whole fails. The run without any fault is a part too.
    """
    for size in range(len(faults)):
        for part in combinations(faults, size):
            why = failure_of(part)
            if why:
                return part, why
    return None


def failure_of(spec: CampaignSettings, walk: Walk, faults: Sequence[WalkFault]) -> str:
    """Run a walk with these faults; returns why it fails, empty where it does not."""
    stage = tuple(fault for fault in faults if isinstance(fault, FaultSettings))
    nodes = [fault for fault in faults if isinstance(fault, NodeFault)]
    sight = scenario_sight(spec, walk.point, walk.law)
    motion_s = max([MOTION_S, *(_over_s(fault, sight) + RECOVERY_S for fault in stage)])
    longer = spec.model_copy(update={"motion_s": motion_s})
    case = Case(_WALK, "", 0.0, "both", Expectation((), False, _WALK), stage)
    scenario = Scenario(case, walk.point, walk.law, walk.seed, longer)
    try:
        pair = make_pair(scenario, nodes)
        run_pair(scenario, pair)
        return judge_walk(pair, nodes, round(motion_s * NS_PER_S))
    except SettingsError:  # a file that the point names, which the user has to correct
        raise
    except Exception as error:
        return f"raised {type(error).__name__}: {error}"


def walk_lines(walks: Sequence[Walk], again: str) -> list[str]:
    """Return the results of the walks, in any order, with the shortest failing sequence first.

    ``again``  the command that runs walks of the same specification, to which a seed is added
    """
    failed = [walk for walk in walks if walk.failure]
    failed.sort(key=lambda walk: (len(walk.shortest), walk.seed))
    count = sum(len(walk.faults) for walk in walks)
    lines = [f"{len(walks)} walks of {count} faults in all: {len(failed)} failed"]
    for walk in failed:
        lines += ["", *_failed_lines(walk), f"  again: {again} --set seed={walk.seed}"]
    return lines


def _failed_lines(walk: Walk) -> list[str]:
    shortest, whole = len(walk.shortest), len(walk.faults)
    how = f"{shortest} of the {whole} faults" if shortest else "without any of them"
    lines = [f"seed {walk.seed}: {walk.shortest_failure} ({how})"]
    if walk.failure != walk.shortest_failure:
        lines.append(f"  all {whole} together: {walk.failure}")
    lines.append(f"  law {walk.law}, point {walk.point.model_dump_json()}")
    return lines + [f"  {_json_of(fault)}" for fault in walk.shortest]


def _json_of(fault: WalkFault) -> str:
    if isinstance(fault, NodeFault):
        return json.dumps(fault._asdict())
    return fault.model_dump_json(exclude_none=True)


def _draw_fault(
    table: CaseSettings | NodeCaseSettings, draw: random.Random, place: int
) -> WalkFault:
    where = draw.choice(table.nodes if isinstance(table, NodeCaseSettings) else table.messages)
    onset_s = round(draw.uniform(FIRST_S, LAST_S), 3)
    duration_s = round(draw.uniform(0.02, DURATION_S_MAX), 3)
    magnitude = draw.choice(table.magnitudes)
    if isinstance(table, NodeCaseSettings):
        return NodeFault(table.kind, where, onset_s, duration_s, magnitude)
    return FaultSettings(
        kind=table.kind,
        direction=direction_of(where),
        message=where,
        signal=table.signal_of(where),
        onset_s=onset_s,
        duration_s=duration_s,
        magnitude=magnitude,
        stream=place,
    )


def _over_s(fault: FaultSettings, sight: Sight) -> float:
    """Return from when a fault of the stage has no effect [s]."""
    end_s = fault.onset_s + fault.duration_s
    if fault.kind is FaultKind.BURST_LOSS:
        return end_s + fault.magnitude * period_s_of(fault, sight)
    return end_s + fault.magnitude if fault.kind is FaultKind.DELAY_SPIKE else end_s
