"""One run of a campaign: the pair in virtual time with a fault, watched and judged."""

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from itertools import pairwise
from typing import NamedTuple

from plant_emulator.plant_samples import PlantSample
from runtime.node import NS_PER_S
from tools.campaign.detectability import MECHANISM_OF, Mechanism
from tools.campaign.observation import SAFE_CAUSES, Watch
from tools.campaign.pair import Pair, make_pair, onset_ns_of, run_pair
from tools.campaign.scenario import GOLDEN, Case, Scenario
from tools.campaign.specification import CONTROLLER, PLANT
from tools.campaign.unheard import is_as_golden, is_heard_by_nobody


class Verdict(StrEnum):
    """How a run came out."""

    PASSED = "passed"
    NOT_DETECTABLE = "not detectable"
    """As classified beforehand; whether it was seen all the same is told beside it."""
    NO_EFFECT = "no effect"
    """The fault changed nothing: its chance never came."""
    MISSED = "missed"
    LATE = "late"
    FALSE_ALARM = "false alarm"
    UNSAFE = "unsafe"
    DISTURBED = "disturbed"
    """A fault where no node listens, and yet the run is not the one without it."""


FAILURES = (
    Verdict.MISSED,
    Verdict.LATE,
    Verdict.FALSE_ALARM,
    Verdict.UNSAFE,
    Verdict.DISTURBED,
)


class Result(NamedTuple):
    """What a run came to; times in seconds, None for what did not happen.

    ``changed``      frames that each fault of the stage changed, lost, added or kept
    ``detected_by``   node and count that saw the fault first, of the expected mechanisms
    ``fdti_s``        from the fault's first effect on the receiver to that count
    ``frti_s``        from there to the receiver's leaving control; 0 where refusing is enough
    ``told_s``        from the first effect to the first frame sent that says so
    ``counts``        what either node counted after the onset
    ``corrupted``     frames delivered that nobody has sent so; ``corrupted_accepted`` of them
    ``as_golden``     of a fault where no node listens: whether motion and commands are, bit for
                      bit, those of the run without it
    """

    name: str
    kind: str
    where: str
    magnitude: float
    point: str
    law: str
    seed: int
    expected: str
    why: str
    changed: list[int]
    detected_by: str
    fdti_s: float | None
    frti_s: float | None
    fhti_s: float | None
    told_s: float | None
    recovery_s: float | None
    lateral_error_peak_m: float
    steer_rate_peak_rad_s: float
    counts: dict[str, int]
    corrupted: int
    corrupted_accepted: int
    bus_refused: int
    unsafe: str
    verdict: str
    as_golden: bool | None = None


def run_trial(scenario: Scenario) -> Result:
    """Run a scenario; equal scenarios give equal results."""
    pair = make_pair(scenario)
    run_pair(scenario, pair)
    return _result(scenario, pair)


def _result(scenario: Scenario, pair: Pair) -> Result:
    case, point = scenario.case, scenario.point
    effects = [stage.first_ns for stage in pair.edge.stages if stage.first_ns is not None]
    changed = [stage.changed for stage in pair.edge.stages]
    effect_ns = min(effects, default=onset_ns_of(case))
    counts = {
        f"{name}.{cause}": count
        for name, watch in ((PLANT, pair.plant), (CONTROLLER, pair.controller))
        for cause, count in watch.counted().items()
    }
    times = _times(case, pair, effect_ns)
    unsafe = "; ".join(dict.fromkeys([*pair.plant.invalid, *pair.controller.invalid]))
    as_golden = is_as_golden(scenario, pair) if is_heard_by_nobody(case) else None
    is_idle = case.kind != GOLDEN and case.node_fault is None and not any(changed)
    samples = _after(pair.plant_node.samples, effect_ns)
    return Result(
        name=scenario.name,
        kind=case.kind,
        where=case.where,
        magnitude=case.magnitude,
        point=point.name,
        law=scenario.law,
        seed=scenario.seed,
        expected=", ".join(case.expected.mechanisms) or "none",
        why=case.expected.why,
        changed=changed,
        **times._asdict(),
        recovery_s=_recovery_s(scenario, pair, effect_ns),
        lateral_error_peak_m=max((abs(one.lateral_error_m) for one in samples), default=0.0),
        steer_rate_peak_rad_s=_steer_rate_peak(samples),
        counts=counts,
        corrupted=pair.plant.corrupted + pair.controller.corrupted,
        corrupted_accepted=pair.plant.corrupted_accepted + pair.controller.corrupted_accepted,
        bus_refused=pair.bus.refused,
        unsafe=unsafe,
        verdict=_verdict(scenario, times, counts, unsafe, is_idle, as_golden),
        as_golden=as_golden,
    )


class _Times(NamedTuple):
    detected_by: str
    fdti_s: float | None
    frti_s: float | None
    fhti_s: float | None
    told_s: float | None


def _times(case: Case, pair: Pair, effect_ns: int) -> _Times:
    """Return when the receiver saw the fault, the slower of two; what the plant sees behind its
    latency line counts from when the fault's first effect came out of it.
    """
    found: list[_Times] = []
    for name, watch in ((PLANT, pair.plant), (CONTROLLER, pair.controller)):
        if case.receiver not in (name, "both") or not case.expected.mechanisms:
            continue
        late_ns = _downlink_latency_ns(pair) if name == PLANT else 0
        seen = _since(watch, case.expected.mechanisms, effect_ns, late_ns)
        if not seen:
            return _Times("", None, None, None, None)
        fdti_s, cause = min(seen)
        safe = [
            since_s
            for since_s, one in _since(watch, None, effect_ns, late_ns)
            if one in SAFE_CAUSES
        ]
        fhti_s: float | None = fdti_s
        if case.expected.safe_state:
            fhti_s = max(fdti_s, min(safe)) if safe else None
        told = [at_ns for at_ns in watch.told_ns if at_ns >= effect_ns]
        told_s = (told[0] - effect_ns) / NS_PER_S if told else None
        frti_s = None if fhti_s is None else fhti_s - fdti_s
        found.append(_Times(f"{name}.{cause}", fdti_s, frti_s, fhti_s, told_s))
    if not found:
        return _Times("", None, None, None, None)
    return max(found, key=lambda times: float("inf") if times.fhti_s is None else times.fhti_s)


def _downlink_latency_ns(pair: Pair) -> int:
    """Return the latency of the command in effect when the plant saw the fault [ns]."""
    seen = [pair.plant.first_seen_ns.get(cause) for cause in ("silence", "intervention")]
    seen_ns = min((at_ns for at_ns in seen if at_ns is not None), default=0)
    for sample in reversed(pair.plant_node.samples):
        if sample.time_s <= seen_ns / NS_PER_S and not math.isnan(sample.downlink_latency_s):
            return round(sample.downlink_latency_s * NS_PER_S)
    return 0


def _since(
    watch: Watch, mechanisms: Sequence[Mechanism] | None, effect_ns: int, late_ns: int
) -> list[tuple[float, str]]:
    """Return how long after the effect each cause was first counted [s]."""
    seen = []
    for cause, at_ns in watch.first_seen_ns.items():
        mechanism = MECHANISM_OF.get(cause)
        if mechanism is None or (mechanisms is not None and mechanism not in mechanisms):
            continue
        # What acts behind the latency line learns of it one latency later.
        behind_line = mechanism in (Mechanism.FRESHNESS, Mechanism.LIMITER)
        seen.append(((at_ns - effect_ns - (late_ns if behind_line else 0)) / NS_PER_S, cause))
    return seen


def _verdict(
    scenario: Scenario,
    times: _Times,
    counts: Mapping[str, int],
    unsafe: str,
    is_idle: bool,
    as_golden: bool | None,
) -> Verdict:
    case, ftti_s = scenario.case, 1e-3 * scenario.spec.ftti_ms
    if unsafe:
        return Verdict.UNSAFE
    if case.kind == GOLDEN:
        return Verdict.FALSE_ALARM if counts else Verdict.PASSED
    if is_idle:
        return Verdict.NO_EFFECT
    if as_golden is not None and (counts or not as_golden):
        return Verdict.DISTURBED
    if not case.expected.mechanisms:
        return Verdict.NOT_DETECTABLE
    if times.fdti_s is None or times.fhti_s is None:
        return Verdict.MISSED
    return Verdict.LATE if times.fhti_s > ftti_s else Verdict.PASSED


def _recovery_s(scenario: Scenario, pair: Pair, effect_ns: int) -> float | None:
    """Return how long after the fault's end either node left control last [s]; None: for good."""
    end_ns = effect_ns + round(scenario.spec.fault_s * NS_PER_S)
    recovered_ns = end_ns
    for watch in (pair.plant, pair.controller):
        states = [(at_ns, bad) for at_ns, bad in watch.states if at_ns >= effect_ns]
        if states and states[-1][1]:
            return None
        if states:
            recovered_ns = max(recovered_ns, states[-1][0])
    return (recovered_ns - end_ns) / NS_PER_S


def _after(samples: Sequence[PlantSample], effect_ns: int) -> list[PlantSample]:
    return [one for one in samples if one.time_s >= effect_ns / NS_PER_S]


def _steer_rate_peak(samples: Sequence[PlantSample]) -> float:
    """Return the largest rate of the wheel between two samples [rad/s]."""
    rates = [
        abs(b.wheel_angle_rad - a.wheel_angle_rad) / (b.time_s - a.time_s)
        for a, b in pairwise(samples)
        if b.time_s > a.time_s
    ]
    return max(rates, default=0.0)
