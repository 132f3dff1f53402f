"""Judges a live run: which program detected the fault, how and when, and how the vehicle moved.

Three independent sources are read: the counters in both reports; the frames on the bus with the
bus's time stamps; and each program's own recording, which also covers times at which the bus
carries nothing. A frame counts as a program's own only if its own recording has it: an intruder may
have sent the same identifier.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ....closed_loop.pair.pair_result import CONTROLLER_PROGRAM, PLANT_PROGRAM
from ....dbc.messages import (
    CAN_IDS,
    ControllerFault,
    ControllerSafety,
    ControllerStatus,
    Decoded,
    Freshness,
    LateralError,
    Message,
    PlantStatus,
    SteeringCommand,
    SteeringStatus,
    decode,
)
from ....runtime.frame import FD, Frame
from ....runtime.node import NS_PER_S
from ....runtime.recording.candump import CandumpReader, parse_entry
from ..campaign.node_watch import HELD_MODES, REPORTING_CODES, REPORTING_SAFETY
from .cases import LIMITED, LOST, PLANT_ONSET_S, SILENCE, SKIPPED
from .live_trial import Trial

_SIGKILL_STATUS = -9
_PAYLOAD_BYTES = 8
_COMMAND_ID = CAN_IDS[SteeringCommand]
_OF_THE_MACHINE = frozenset({SKIPPED})
"""A run without a fault does not fail by these: a shared machine may stall."""
TimedMessage = tuple[int, Message]
"""A message and its time on the wall clock [ns]."""


class Reaction(NamedTuple):
    """When a program first reported the fault after its onset [s]; None: it did not.

    ``noticed_s``  by the frame it handed to the bus
    ``reported_s``     by the frame that was complete on the bus
    """

    noticed_s: float | None
    reported_s: float | None


class Vehicle(NamedTuple):
    """Motion of the vehicle: greatest deviation at the preview point and angle of the wheel after
    the onset, the same before it, and the plant's last status; None where it sent nothing.
    """

    error_peak_m: float | None
    error_before_m: float | None
    wheel_peak_rad: float | None
    wheel_before_rad: float | None
    last_status: str


class LiveResult(NamedTuple):
    """One run, judged.

    ``counts``     above zero in the reports, by program and cause
    ``reactions``   by program
    ``mistakes``   what is not as expected; the run passes if there are none
    """

    name: str
    counts: Mapping[str, Mapping[str, int]]
    reactions: Mapping[str, Reaction]
    vehicle: Vehicle
    statuses: Mapping[str, int]
    actions: Sequence[Mapping[str, Any]]
    mistakes: Sequence[str]


def judge_trial(trial: Trial) -> LiveResult:
    """Read the files of a run, and judge it."""
    programs, reports = (PLANT_PROGRAM, CONTROLLER_PROGRAM), trial.run.reports
    counts = {name: counts_of(reports[name]) for name in programs if name in reports}
    end_ns = trial.observed[1]
    on_bus = _bus_frames(trial.run.bus_log)
    onset_ns = _onset_ns(trial, on_bus)
    reactions, sent = {}, {}
    for name in programs:
        sent[name] = _sent(trial.run.own_log(name))
        own = {frame for _, frame in sent[name]}
        seen = [(time_ns, frame) for time_ns, frame in on_bus if frame in own]
        reactions[name] = Reaction(
            _first_sign(sent[name], onset_ns, end_ns), _first_sign(seen, onset_ns, end_ns)
        )
    vehicle = vehicle_of(list(_decoded(sent[PLANT_PROGRAM])), onset_ns, end_ns)
    mistakes = list(mistakes_of(trial, counts))
    return LiveResult(
        trial.case.name, counts, reactions, vehicle, trial.run.statuses, trial.actions, mistakes
    )


def counts_of(report: Mapping[str, Any]) -> dict[str, int]:
    """Return a program's fault counters that are above zero, by cause."""
    node = report["node"]
    counts = dict(node["rejected"])
    counts |= node.get("authentication", {}).get("refused", {})
    counts |= report["connection"]["error_frames"]
    if "safety" in node:
        counts[SILENCE] = node["safety"]["holdings"]
        counts[LIMITED] = sum(node["safety"]["interventions"].values())
        counts[LOST], counts[SKIPPED] = node["lost_on_the_bus"], node["skipped_samples"]
    else:
        counts[SILENCE], counts[LOST] = node["holds"], node["lost"]
        counts[SKIPPED] = node["skipped_ticks"]
    return {cause: count for cause, count in counts.items() if count}


def mistakes_of(trial: Trial, counts: Mapping[str, Mapping[str, int]]) -> Iterator[str]:
    """Yield what is not as expected, in words."""
    case = trial.case
    for name, causes in case.expected.items():
        if not {*causes} & {*counts.get(name, {})}:
            yield f"{name} has not noticed it"
    if not case.inject and not case.at_plant:
        for name, seen in counts.items():
            if set(seen) - _OF_THE_MACHINE:
                yield f"{name} counts {dict(seen)}"
    elif case.at_plant and not changed_by_stage(trial):
        yield "the plant's fault stage did nothing"
    elif case.inject and not trial.actions:
        yield "the injector did nothing"
    for name, status in trial.run.statuses.items():
        is_killed = name in case.targets and case.inject.startswith("kill")
        if status != case.ends.get(name, _SIGKILL_STATUS if is_killed else 0):
            yield f"{name} has ended with status {status}"
    if trial.run.cut_off:
        yield f"the recording of the bus was cut off: {trial.run.cut_off}"
    yield from (f"left behind: {what}" for what in trial.run.left)


def changed_by_stage(trial: Trial) -> int:
    """Return how many frames the fault stage at the plant's edge has changed."""
    faults = trial.run.reports.get(PLANT_PROGRAM, {}).get("node", {}).get("faults", [])
    return sum(one["changed"] for one in faults)


def _onset_ns(trial: Trial, on_bus: Sequence[tuple[int, Frame]]) -> int:
    """Return when the fault began, by the wall clock [ns]; without one, when it could have."""
    if trial.case.at_plant:
        first_ns = next((t for t, frame in on_bus if frame.can_id == _COMMAND_ID), 0)
        return first_ns + round(PLANT_ONSET_S * NS_PER_S)
    return trial.actions[0]["time_ns"] if trial.actions else trial.observed[0]


def vehicle_of(messages: Sequence[TimedMessage], onset_ns: int, end_ns: int) -> Vehicle:
    """Return the motion of the vehicle up to ``end_ns``, from the plant's own messages."""
    statuses = [one for t, one in messages if isinstance(one, SteeringStatus) and t < end_ns]

    errors = [(t, one.lateral_error_m) for t, one in messages if isinstance(one, LateralError)]
    angles = [(t, one.wheel_angle_rad) for t, one in messages if isinstance(one, SteeringStatus)]

    def peak(values: Sequence[tuple[int, float]], from_ns: int, to_ns: int) -> float | None:
        return max((abs(value) for t, value in values if from_ns <= t < to_ns), default=None)

    return Vehicle(
        peak(errors, onset_ns, end_ns),
        peak(errors, 0, onset_ns),
        peak(angles, onset_ns, end_ns),
        peak(angles, 0, onset_ns),
        statuses[-1].status.name if statuses else "none",
    )


def _first_sign(frames: Sequence[tuple[int, Frame]], onset_ns: int, end_ns: int) -> float | None:
    """Return how long after the onset a program's own messages first report the fault [s]."""
    before = (0, 0)
    for time_ns, message in _decoded(frames):
        if time_ns >= end_ns:
            break
        if time_ns < onset_ns:
            before = _refused(message) or before
        elif _is_sign(message, before):
            return (time_ns - onset_ns) / NS_PER_S
    return None


def _refused(message: Message) -> tuple[int, int] | None:
    """Return how many frames a sender has rejected and missed, if the message contains that."""
    match message:
        case PlantStatus():
            return message.rejected, 0
        case ControllerSafety():
            return message.rejected, message.lost
    return None


def _is_sign(message: Message, before: tuple[int, int]) -> bool:
    """Whether a message reports that its sender has detected a fault since ``before``."""
    match message:
        case SteeringCommand() | ControllerStatus():
            return message.mode in HELD_MODES
        case SteeringStatus():
            return message.status in REPORTING_CODES
        case PlantStatus():
            return message.safety in REPORTING_SAFETY or _refused(message) != before
        case ControllerSafety():
            is_stale = message.lateral_error_freshness is Freshness.STALE
            is_well = message.fault is ControllerFault.NONE
            return is_stale or not is_well or _refused(message) != before
    return False


def _decoded(frames: Sequence[tuple[int, Frame]]) -> Iterator[TimedMessage]:
    for time_ns, frame in frames:
        # An authenticated frame begins with the classic one that it was made from.
        is_classic = not frame.flags & FD
        decoded = decode(frame if is_classic else Frame(frame.can_id, frame.data[:_PAYLOAD_BYTES]))
        if isinstance(decoded, Decoded):
            yield time_ns, decoded.message


def _bus_frames(path: Path) -> list[tuple[int, Frame]]:
    with path.open(encoding="ascii") as lines:
        return [(time_ns, frame) for time_ns, _, frame in CandumpReader(lines)]


def _sent(path: Path) -> list[tuple[int, Frame]]:
    with path.open(encoding="ascii") as lines:
        entries = [parse_entry(line) for line in lines if line.endswith(" T\n")]
    return sorted(
        ((entry.time_ns, entry.frame) for entry in entries if entry is not None),
        key=lambda one: one[0],
    )
