"""How soon the receiver of a fault detected it, reacted to it and reported it."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from ....runtime.node import NEVER_NS, NS_PER_S
from ....runtime.node.end import End
from .campaign_runs import FaultCase
from .detectability import Mechanism, causes_of
from .node_watch import SAFE_CAUSES, Watch
from .watched_pair import Pair


class Times(NamedTuple):
    """By which counter the receiver detected the fault, and the times of its reactions [s]."""

    detected_by: str
    fdti_s: float | None
    frti_s: float | None
    fhti_s: float | None
    reported_s: float | None


_UNSEEN = Times("", None, None, None, None)


def times_of(case: FaultCase, pair: Pair, effect_ns: int) -> tuple[Times, int | None]:
    """Return the slower receiver's times, and when the fault was first detected [ns].

    What the plant detects behind its latency line counts from when the fault's first effect left
    that line.
    """
    detected_ns: int | None = None
    found: list[Times] = []
    for name, watch in ((End.PLANT, pair.plant), (End.CONTROLLER, pair.controller)):
        if case.receiver not in (name, "both") or not case.expected.mechanisms:
            continue
        late_ns = _downlink_latency_ns(pair) if name == End.PLANT else 0
        seen = _since(watch, case.expected.mechanisms, effect_ns, late_ns)
        if not seen:
            return _UNSEEN, None
        fdti_s, cause = min(seen)
        detected_ns = min(watch.first_seen_ns[cause], detected_ns or NEVER_NS)
        any_cause = _since(watch, tuple(Mechanism), effect_ns, late_ns)
        safe = [since_s for since_s, one in any_cause if one in SAFE_CAUSES]
        fhti_s: float | None = fdti_s
        if case.expected.safe_state:
            fhti_s = max(fdti_s, min(safe)) if safe else None
        reports_ns = [at_ns for at_ns in watch.reported_ns if at_ns >= effect_ns]
        reported_s = (reports_ns[0] - effect_ns) / NS_PER_S if reports_ns else None
        frti_s = None if fhti_s is None else fhti_s - fdti_s
        found.append(Times(f"{name}.{cause}", fdti_s, frti_s, fhti_s, reported_s))
    if not found:
        return _UNSEEN, None
    slowest = max(found, key=lambda times: math.inf if times.fhti_s is None else times.fhti_s)
    return slowest, detected_ns


def _downlink_latency_ns(pair: Pair) -> int:
    """Return the latency of the command in effect when the plant detected the fault [ns]."""
    detected = [pair.plant.first_seen_ns.get(cause) for cause in ("silence", "intervention")]
    detected_ns = min((at_ns for at_ns in detected if at_ns is not None), default=0)
    started_ns = pair.plant.started_ns or 0
    for sample in pair.plant_node.samples:  # the first one that has it in effect
        is_since = round(sample.time_s * NS_PER_S) + started_ns >= detected_ns
        if is_since and not math.isnan(sample.downlink_latency_s):
            return round(sample.downlink_latency_s * NS_PER_S)
    return 0


def _since(
    watch: Watch, mechanisms: Sequence[Mechanism], effect_ns: int, late_ns: int
) -> list[tuple[float, str]]:
    """Return how long after the effect each cause was first counted [s]."""
    # What acts behind the latency line is affected one latency later.
    behind_line = causes_of((Mechanism.FRESHNESS, Mechanism.LIMITER))
    causes = causes_of(mechanisms)
    return [
        ((at_ns - effect_ns - (late_ns if cause in behind_line else 0)) / NS_PER_S, cause)
        for cause, at_ns in watch.first_seen_ns.items()
        if cause in causes
    ]
