"""Conditions that every walk of faults must meet, however its faults interact.

1. No node sends what does not decode, or is beyond its limits.
2. No corrupted frame is accepted.
3. A node that meets detectable faults counts something that one of their mechanisms detects. It
   meets a fault if it is present (not killed, paused or off the bus, nor cut off by a babbling
   node) from the fault's first effect until it must have detected the last one. A silence also has
   to outlast the age limit by as much as the walk's delays and the jitter can shorten it.
4. Once every fault has been over for RECOVERY_S, a node is in control again if its peer lives, and
   out of control, in its safe state, if its peer was killed. Of a killed node nothing is required.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from steer_by_wire.plant_emulator.faults.settings import FaultKind
from steer_by_wire.runtime.node import NEVER_NS, NS_PER_S
from steer_by_wire.runtime.node.end import End
from steer_by_wire.tools.faults.campaign.campaign_file import BUS, NodeFaultKind
from steer_by_wire.tools.faults.campaign.campaign_runs import (
    FaultCase,
    case_of_fault,
    case_of_node_fault,
)
from steer_by_wire.tools.faults.campaign.detectability import MECHANISM_OF, Mechanism
from steer_by_wire.tools.faults.campaign.node_faults import NodeFault
from steer_by_wire.tools.faults.campaign.node_watch import Watch
from steer_by_wire.tools.faults.campaign.watched_pair import Pair

RECOVERY_S = 3.5
"""Time after the last fault within which both nodes must have recovered."""
SETTLING_S = 1.0
"""How long a node that was away may take until it acts on commands as before."""
_PEER = {End.PLANT: End.CONTROLLER, End.CONTROLLER: End.PLANT}


class _Span(NamedTuple):
    from_ns: int
    to_ns: int

    def meets(self, other: "_Span") -> bool:
        return self.from_ns <= other.to_ns and other.from_ns <= self.to_ns


class _Met(NamedTuple):
    """A fault that had an effect: which node it affects, and from its onset until all is detected.

    ``silence_s``  how long it keeps the receiver without frames at least, if it does
    """

    case: FaultCase
    span: _Span
    silence_s: float


def judge_walk(pair: Pair, faults: Sequence[NodeFault], end_ns: int) -> str:
    """Return why a run that is over fails; empty where it does not.

    ``faults``  of nodes; those of the stage are in the pair
    """
    watches = {End.PLANT: pair.plant, End.CONTROLLER: pair.controller}
    invalid = [text for watch in watches.values() for text in watch.invalid]
    if invalid:
        return "; ".join(dict.fromkeys(invalid))
    accepted = sum(watch.corrupted_accepted for watch in watches.values())
    if accepted:
        return f"{accepted} corrupted frames accepted"
    for name, watch in watches.items():
        failure = _unseen(name, watch, pair, faults)
        failure = failure or _out_of_place(name, watch, pair, faults, end_ns)
        if failure:
            return failure
    return ""


def _unseen(name: str, watch: Watch, pair: Pair, faults: Sequence[NodeFault]) -> str:
    """Report that a node met detectable faults and counted nothing that indicates them."""
    away = [*_away(name, faults)]
    all_away = [*away, *_away(_PEER[name], faults)]
    mechanisms: set[Mechanism] = set()
    for met in (*_met_stages(pair), *_met_nodes(pair, faults)):
        if met.case.receiver not in (name, "both"):
            continue
        expected = met.case.expected.mechanisms
        # A command that the unit does not follow yet after a silence is not limited by it.
        others = all_away if Mechanism.LIMITER in expected else away
        own = met.case.node_fault
        if any(met.span.meets(span) for span, by in others if by != own):
            continue
        if expected != (Mechanism.FRESHNESS,) or met.silence_s > pair.sight.age_limit_s:
            mechanisms.update(expected)
    seen = {MECHANISM_OF.get(cause) for cause in watch.counted()}
    return f"the {name} counted nothing" if mechanisms and not mechanisms & seen else ""


def _out_of_place(
    name: str, watch: Watch, pair: Pair, faults: Sequence[NodeFault], end_ns: int
) -> str:
    """Report that a node is not in the required state at the end."""
    killed = {fault.node for fault in faults if fault.kind is NodeFaultKind.KILLED}
    if name in killed:
        return ""
    if not watch.states:
        return f"the {name} has sent nothing"
    is_abnormal = watch.states[-1][1]
    if _PEER[name] in killed:
        return "" if is_abnormal else f"the {name} is in control although its peer is dead"
    ends_ns = [fault.window_ns[1] for fault in faults if fault.kind is not NodeFaultKind.KILLED]
    last_ns = max([*ends_ns, *(stage.last_ns or 0 for stage in pair.edge.stages)], default=0)
    is_over = last_ns + RECOVERY_S * NS_PER_S <= end_ns
    return f"the {name} is not in control again" if is_abnormal and is_over else ""


def _noticed_ns(pair: Pair) -> int:
    """Return how long after an effect it must have been detected [ns]."""
    return round((pair.sight.age_limit_s + pair.way.latency_s) * NS_PER_S)


def _met_stages(pair: Pair) -> Iterator[_Met]:
    for stage in pair.edge.stages:
        if stage.first_ns is None or stage.last_ns is None:
            continue
        fault = stage.settings
        end_ns = stage.last_ns + _noticed_ns(pair)
        silence_s = fault.duration_s
        if fault.kind is FaultKind.DELAY_SPIKE:  # its own delay does not shorten it
            silence_s = min(fault.magnitude, fault.duration_s) + fault.magnitude
        span = _Span(stage.first_ns, end_ns)
        yield _Met(case_of_fault(fault, pair.sight), span, silence_s - _shortened_s(pair))


def _shortened_s(pair: Pair) -> float:
    """Return by how much late frames may shorten a silence [s]."""
    faults = [stage.settings for stage in pair.edge.stages]
    delays_s = [one.magnitude for one in faults if one.kind is FaultKind.DELAY_SPIKE]
    return sum(delays_s) + pair.way.spread_s


def _met_nodes(pair: Pair, faults: Sequence[NodeFault]) -> Iterator[_Met]:
    for fault in faults:
        onset_ns, end_ns = fault.window_ns
        is_killed = fault.kind is NodeFaultKind.KILLED
        until_ns = (onset_ns if is_killed else end_ns) + _noticed_ns(pair)
        silence_s = math.inf if is_killed else fault.duration_s - _shortened_s(pair)
        yield _Met(case_of_node_fault(fault, pair.sight), _Span(onset_ns, until_ns), silence_s)


def _away(name: str, faults: Sequence[NodeFault]) -> Iterator[tuple[_Span, NodeFault]]:
    """Yield when frames do not reach a node or have no effect there, and by which fault."""
    for fault in faults:
        if fault.node in (name, BUS) and fault.kind is not NodeFaultKind.CLOCK_JUMP:
            onset_ns, end_ns = fault.window_ns
            if end_ns != NEVER_NS:
                end_ns += round(SETTLING_S * NS_PER_S)
            yield _Span(onset_ns, end_ns), fault
