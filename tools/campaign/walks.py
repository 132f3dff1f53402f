"""Random walks: seeded sequences of faults that overlap, and the shortest one that still fails.

A walk fails where a run raises, a node sends what it must not, a corrupted frame is accepted, a
node that meets a detectable fault counts nothing that its mechanisms can see, or a node is not in
control again once all faults have long been over. A failing sequence is shortened by leaving out
one fault after the other while it still fails, until none can be left out (each draws from a stream
of its own, so what is left does what it did).
"""

import random
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from plant_emulator.fault_settings import FaultSettings
from tools.campaign.detectability import MECHANISM_OF, Expectation
from tools.campaign.execution import execute
from tools.campaign.scenario import Case, Scenario, case_of_fault
from tools.campaign.specification import CONTROLLER, PLANT, CampaignSettings, direction_of
from tools.campaign.trial import Result, run_trial

WALK_FAULTS_MAX = 6
FIRST_S, LAST_S = 1.0, 5.0
"""When the faults of a walk may begin."""
DURATION_S_MAX = 1.5
MOTION_S = 10.0
"""The rest is there to recover in."""
_WALK = "walk"


class Walk(NamedTuple):
    """A sequence of faults and, if it fails, why, and its shortest part that fails too."""

    seed: int
    faults: tuple[FaultSettings, ...]
    failure: str
    shortest: tuple[FaultSettings, ...]


def walk_all(
    spec: CampaignSettings, count: int, processes: int, take: Callable[[Walk], None]
) -> None:
    """Do ``count`` walks; ``take`` gets each when it is done, which may be in any order."""
    execute(partial(one_walk, spec), range(spec.seed, spec.seed + count), processes, take)


def one_walk(spec: CampaignSettings, seed: int) -> Walk:
    """Draw one walk, run it and, if it fails, shorten it."""
    draw = random.Random(seed)  # noqa: S311 no secret
    faults = tuple(
        _draw_fault(spec, draw, place) for place in range(draw.randint(2, WALK_FAULTS_MAX))
    )
    point, law = draw.choice(spec.points), draw.choice(spec.laws)
    longer = spec.model_copy(update={"motion_s": MOTION_S})

    def failure_of(sequence: Sequence[FaultSettings]) -> str:
        case = Case(_WALK, "", 0.0, "both", tuple(sequence), None, Expectation((), False, _WALK))
        return _failure(Scenario(case, point, law, seed, longer))

    failure = failure_of(faults)
    shortest = shorten(faults, lambda part: bool(failure_of(part))) if failure else ()
    return Walk(seed, faults, failure, shortest)


def shorten(
    faults: Sequence[FaultSettings], fails: Callable[[Sequence[FaultSettings]], bool]
) -> tuple[FaultSettings, ...]:
    """Return a part of a failing sequence that fails, and of which nothing can be left out."""
    shortest = tuple(faults)
    place = 0
    while place < len(shortest):
        part = shortest[:place] + shortest[place + 1 :]
        if part and fails(part):
            shortest, place = part, 0  # what could not be left out before may be now
        else:
            place += 1
    return shortest


def walk_lines(walks: Sequence[Walk]) -> list[str]:
    """Return what came of the walks, in any order, with the shortest failing sequence first."""
    failed = sorted(
        (walk for walk in walks if walk.failure), key=lambda walk: (len(walk.shortest), walk.seed)
    )
    count = sum(len(walk.faults) for walk in walks)
    lines = [f"{len(walks)} walks of {count} faults in all: {len(failed)} failed"]
    for walk in failed:
        lines.append(f"seed {walk.seed}: {walk.failure}; {len(walk.shortest)} of the faults do it:")
        lines += [f"  {fault.model_dump_json(exclude_none=True)}" for fault in walk.shortest]
    return lines


def _draw_fault(spec: CampaignSettings, draw: random.Random, place: int) -> FaultSettings:
    """Draw a fault of the specification's cases, when it begins and how long it lasts."""
    table = draw.choice(spec.cases)
    message = draw.choice(table.messages)
    return FaultSettings(
        kind=table.kind,
        direction=direction_of(message),
        message=message,
        signal=table.signal_of(message),
        onset_s=round(draw.uniform(FIRST_S, LAST_S), 3),
        duration_s=round(draw.uniform(0.02, DURATION_S_MAX), 3),
        magnitude=draw.choice(table.magnitudes),
        stream=place,
    )


def _failure(scenario: Scenario) -> str:
    """Return why a walk fails; empty where it does not."""
    try:
        result = run_trial(scenario)
    except Exception as error:
        return f"raised {type(error).__name__}: {error}"
    if result.unsafe:
        return result.unsafe
    if result.corrupted_accepted:
        return f"{result.corrupted_accepted} corrupted frames accepted"
    if result.recovery_s is None:
        return "a node is not in control again"
    return _unseen(scenario, result)


def _unseen(scenario: Scenario, result: Result) -> str:
    """Name a node that met detectable faults and counted nothing they can be seen by."""
    for node in (PLANT, CONTROLLER):
        faults = zip(scenario.case.faults, result.changed, strict=True)
        cases = [case_of_fault(fault) for fault, changed in faults if changed]
        mechanisms = {
            mechanism
            for case in cases
            if case.receiver == node
            for mechanism in case.expected.mechanisms
        }
        seen = {MECHANISM_OF.get(name.split(".")[1]) for name in result.counts if node in name}
        if mechanisms and not mechanisms & seen:
            return f"the {node} counted nothing"
    return ""
