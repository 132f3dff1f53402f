"""One run of a campaign: the pair in virtual time with a fault, watched and judged."""

from collections.abc import Sequence
from enum import StrEnum
from itertools import pairwise
from typing import Any, NamedTuple

from ....plant_emulator.evaluation.run_record import PlantSample
from ....runtime.node import NS_PER_S
from ....runtime.node.end import End
from .campaign_file import BUS, NodeFaultKind
from .campaign_runs import GOLDEN, FaultCase, Scenario
from .golden_comparison import is_as_golden
from .reaction_times import times_of
from .recovery import command_returns, wheel_steps
from .watched_pair import Pair, make_pair, onset_ns_of, run_pair


class Detection(StrEnum):
    """Detection on a run."""

    PASSED = "passed"
    NOT_DETECTABLE = "not detectable"
    """Not detectable, as classified beforehand; it is reported whether it was detected anyway."""
    FOLLOWED = "detected, followed"
    """As classified beforehand: detected in time, but false frames were still accepted, as nothing
    distinguishes them from true ones."""
    NO_CHANCE = "no chance"
    """The fault changed nothing, which its random draws allow, as classified beforehand."""
    NO_EFFECT = "no effect"
    """The fault changed nothing, and should have."""
    MISSED = "missed"
    LATE = "late"
    EARLY = "before the onset"
    """Something was counted before the fault had any effect."""
    FALSE_ALARM = "false alarm"
    UNSAFE = "unsafe"
    BELIEVED = "believed"
    """After the detection, false frames were accepted that the receiver can distinguish."""
    NOT_RECOVERED = "not recovered"
    """A node was not in control again, or too late, although its peer lived."""
    JUMPED = "jumped"
    """The command or the wheel stepped further on the way back than limits and fades allow."""
    DISTURBED = "disturbed"
    """A fault on messages that no node receives changed the run."""


_JUMPS_SHOWN = 2
_KEEPING_COMMANDS = ((NodeFaultKind.PAUSED, End.PLANT), (NodeFaultKind.BABBLING, BUS))
"""Where commands wait, in a socket or for the bus, and then come all at once."""
_AS_EXPECTED = (Detection.PASSED, Detection.NOT_DETECTABLE, Detection.FOLLOWED, Detection.NO_CHANCE)
FAILURES = frozenset(Detection).difference(_AS_EXPECTED)


class RunResult(NamedTuple):
    """The result of a run; times in seconds, None for what did not happen.

    ``changed``      frames that each fault of the stage changed, lost, added or kept
    ``detected_by``   node and counter that detected the fault first, of the expected mechanisms
    ``fdti_s``        from the fault's first effect on the receiver to that count
    ``frti_s``        from there until the receiver leaves control, where it has to; else 0 where
                      frames are rejected, None where false ones are still accepted
    ``reported_s``        from the first effect to the first frame sent that reports it
    ``counts``        what either node counted after the onset
    ``corrupted``     frames delivered that nobody has sent so; ``corrupted_accepted`` of them
    ``as_golden``     of a fault where no node listens: whether motion and commands are, bit for
                      bit, those of the run without it
    ``safe_state``    whether the receiver has to leave control
    ``false_frames``  that the fault made of others, or added to them; ``false_accepted`` of them,
                      and ``false_after`` of these after the detection
    ``recovery_allowed_s``  by the settings; None where no node has to recover
    ``command_return_rad``, ``wheel_return_rad``  largest steps at the returns into control, without
                      the effect of commands that arrive together with the first
    ``jumps``         steps that exceed what limits and fades allow
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
    reported_s: float | None
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
    safe_state: bool = False
    false_frames: int = 0
    false_accepted: int = 0
    false_after: int = 0
    recovery_allowed_s: float | None = None
    command_return_rad: float | None = None
    wheel_return_rad: float | None = None
    jumps: str = ""

    @property
    def label(self) -> str:
        """What goes wrong, in a line."""
        return f"{self.kind} {self.magnitude:g} {self.where}"

    @property
    def is_back(self) -> bool:
        """Whether both nodes were in control again in time, if they had to be."""
        allowed_s, took_s = self.recovery_allowed_s, self.recovery_s
        return allowed_s is None or (took_s is not None and took_s <= allowed_s)


def run_trial(scenario: Scenario) -> RunResult:
    """Run a scenario; equal scenarios give equal results."""
    pair = make_pair(scenario)
    run_pair(scenario, pair)
    return _result(scenario, pair)


def _result(scenario: Scenario, pair: Pair) -> RunResult:
    case, point = scenario.case, scenario.point
    effects = [stage.first_ns for stage in pair.edge.stages if stage.first_ns is not None]
    changed = [stage.changed for stage in pair.edge.stages]
    effect_ns = min(effects, default=onset_ns_of(case))
    counts = {
        f"{name}.{cause}": count
        for name, watch in ((End.PLANT, pair.plant), (End.CONTROLLER, pair.controller))
        for cause, count in watch.counted().items()
    }
    times, detected_ns = times_of(case, pair, effect_ns)
    false_ns = [*pair.plant.false_ns, *pair.controller.false_ns]
    unsafe = "; ".join(dict.fromkeys([*pair.plant.invalid, *pair.controller.invalid]))
    as_golden = is_as_golden(scenario, pair) if case.is_unreceived else None
    is_idle = case.kind != GOLDEN and case.node_fault is None and not any(changed)
    samples = [one for one in pair.plant_node.samples if one.time_s >= effect_ns / NS_PER_S]
    result = RunResult(
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
        **_way_back(scenario, pair, effect_ns),
        lateral_error_peak_m=max((abs(one.lateral_error_m) for one in samples), default=0.0),
        steer_rate_peak_rad_s=_steer_rate_peak(samples),
        counts=counts,
        corrupted=pair.plant.corrupted + pair.controller.corrupted,
        corrupted_accepted=pair.plant.corrupted_accepted + pair.controller.corrupted_accepted,
        bus_refused=pair.bus.refused,
        unsafe=unsafe,
        verdict=Detection.PASSED,
        as_golden=as_golden,
        safe_state=case.expected.safe_state,
        false_frames=pair.plant.false_frames + pair.controller.false_frames,
        false_accepted=len(false_ns),
        false_after=sum(detected_ns is not None and at_ns > detected_ns for at_ns in false_ns),
    )
    if result.false_after and not case.expected.safe_state:
        result = result._replace(frti_s=None, fhti_s=None)
    return result._replace(
        verdict=detection_of(case, result, 1e-3 * scenario.spec.ftti_ms, is_idle)
    )


def detection_of(case: FaultCase, result: RunResult, ftti_s: float, is_idle: bool) -> Detection:
    """Judge a run; the first verdict that applies, the worst first.

    ``is_idle``  whether the fault changed no frame
    """
    if result.unsafe:
        return Detection.UNSAFE
    if case.kind == GOLDEN:
        return Detection.FALSE_ALARM if result.counts else Detection.PASSED
    if is_idle:
        return Detection.NO_CHANCE if case.expected.may_be_idle else Detection.NO_EFFECT
    if result.as_golden is not None and (result.counts or not result.as_golden):
        return Detection.DISTURBED
    failure = _late(result, ftti_s) if case.expected.mechanisms else None
    if failure is not None:
        return failure
    if not result.is_back:
        return Detection.NOT_RECOVERED
    if result.jumps:
        return Detection.JUMPED
    if not case.expected.mechanisms:
        return Detection.NOT_DETECTABLE
    # Frames that pass a CRC by chance are judged by their number over all runs.
    if result.false_after and not case.expected.is_followed and not result.corrupted_accepted:
        return Detection.BELIEVED
    return Detection.FOLLOWED if result.false_after else Detection.PASSED


def _late(result: RunResult, ftti_s: float) -> Detection | None:
    """Return what is wrong with when a detectable fault was detected, and control left."""
    if result.fdti_s is None or (result.safe_state and result.fhti_s is None):
        return Detection.MISSED
    if result.fdti_s < 0.0:
        return Detection.EARLY
    slowest_s = result.fdti_s if result.fhti_s is None else result.fhti_s
    return Detection.LATE if slowest_s > ftti_s else None


def _way_back(scenario: Scenario, pair: Pair, effect_ns: int) -> dict[str, Any]:
    """Return the fields of a result about the return into control."""
    case, way = scenario.case, pair.way
    own = case.node_fault
    is_kept_up = own is not None and (own.kind, own.node) in _KEEPING_COMMANDS
    backlog_s = scenario.spec.fault_s if is_kept_up else 0.0
    commands = list(command_returns(way, pair.controller.commands))
    statuses = pair.plant.statuses
    wheel = list(wheel_steps(way, statuses, pair.controller.commands, backlog_s))
    if "intervention" in pair.plant.counted():  # a wheel that a limit releases is not fading
        wheel = [step for step in wheel if step.is_return]
    jumps = [
        f"{step.what} by {step.step_rad:.4f} rad, allowed {step.allowed_rad:.4f}"
        for step in (*commands, *wheel)
        if step.is_jump
    ]
    is_dead = own is not None and own.kind is NodeFaultKind.KILLED
    returns_rad = [step.own_rad for step in wheel if step.is_return]
    return {
        "recovery_s": _recovery_s(pair, effect_ns, _end_ns(scenario, pair, effect_ns)),
        "recovery_allowed_s": None if is_dead or case.kind == GOLDEN else way.recovery_s,
        "command_return_rad": max((step.step_rad for step in commands), default=None),
        "wheel_return_rad": max(returns_rad, default=None),
        "jumps": "; ".join(jumps[:_JUMPS_SHOWN]),
    }


def _end_ns(scenario: Scenario, pair: Pair, effect_ns: int) -> int:
    """Return when a fault is over: with its last effect, a late frame for instance [ns]."""
    fault = scenario.case.node_fault
    if fault is not None and fault.kind is NodeFaultKind.CLOCK_JUMP:
        return effect_ns  # it has no duration
    last_ns = max((stage.last_ns or 0 for stage in pair.edge.stages), default=0)
    return max(effect_ns + round(scenario.spec.fault_s * NS_PER_S), last_ns)


def _recovery_s(pair: Pair, effect_ns: int, end_ns: int) -> float | None:
    """Return how long after the fault's end either node left control last [s]; None: for good."""
    recovered_ns = end_ns
    for watch in (pair.plant, pair.controller):
        states = [(at_ns, bad) for at_ns, bad in watch.states if at_ns >= effect_ns]
        if states and states[-1][1]:
            return None
        if states:
            recovered_ns = max(recovered_ns, states[-1][0])
    return (recovered_ns - end_ns) / NS_PER_S


def _steer_rate_peak(samples: Sequence[PlantSample]) -> float:
    rates = [
        abs(b.wheel_angle_rad - a.wheel_angle_rad) / (b.time_s - a.time_s)
        for a, b in pairwise(samples)
        if b.time_s > a.time_s
    ]
    return max(rates, default=0.0)
