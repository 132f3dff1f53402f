"""Modes of the controller: when it may steer, and what it does when measurements stop.

    mode        the command sent at each tick
    WAITING     none: there was no valid measurement yet
    ACTIVE      the law's, within the limits
    HOLDING     the last one, unchanged
    SAFE_STOP   the last one ramped to zero, then zero

``TRANSITIONS`` defines the whole behaviour: in each mode the first row with a true guard decides,
and without a true guard the mode stays. Guards depend on the age of the newest measurement, the
number of good ones without a gap, a failure of the law, a vehicle that stands or reverses, and a
fault that the controller has detected in itself, which leads to SAFE_STOP for good. The law itself
never branches on any of these.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from ...dbc.messages import Mode
from ...runtime.node import NS_PER_MS
from ..settings import ControllerSettings

MODE_IN_WORDS: Mapping[Mode, str] = {
    Mode.WAITING: "WAITING for the plant's first LATERAL_ERROR",
    Mode.ACTIVE: "ACTIVE: the law steers",
    Mode.HOLDING: "HOLDING the last command: no measurements, no motion forward, or the law failed",
    Mode.SAFE_STOP: "SAFE_STOP: the command ramps to zero",
}


class Supervision(NamedTuple):
    """When a measurement counts, and how long to hold without one.

    ``measurement_timeout_ns``  a measurement older than this is stale [ns]
    ``hold_ns``                 how long the last command is held before the ramp [ns]
    ``recovery_frames``         good measurements, more than damaged ones, that end HOLDING and
                                SAFE_STOP
    """

    measurement_timeout_ns: int
    hold_ns: int
    recovery_frames: int


def supervision_of(settings: ControllerSettings) -> Supervision:
    """Return the parameters of the mode table."""
    table = settings.supervision
    return Supervision(
        measurement_timeout_ns=settings.age_limits.lateral_error_ns,
        hold_ns=round(table.hold_ms * NS_PER_MS),
        recovery_frames=table.recovery_frames,
    )


class ModeState(NamedTuple):
    """The mode, the time it was entered [ns], and the run of good measurements.

    ``good_run``  good measurements without a gap, less the damaged ones among them
    """

    mode: Mode
    entered_ns: int
    good_run: int


class Evidence(NamedTuple):
    """Conditions of a transition besides time.

    ``arrival_ns``   when the newest good measurement arrived, None before the first [ns]
    ``law_failed``   whether the law's output at this tick was not a finite number
    ``own_fault``    whether the controller has detected a fault in itself
    ``goes_forward`` whether the vehicle does, as far as is known
    """

    arrival_ns: int | None
    law_failed: bool
    own_fault: bool
    goes_forward: bool


Guard = Callable[[Supervision, ModeState, Evidence, int], bool]


def is_fresh(p: Supervision, _x: ModeState, evidence: Evidence, now_ns: int) -> bool:
    """Whether there is a measurement recent enough to steer by."""
    return (
        evidence.arrival_ns is not None and now_ns - evidence.arrival_ns <= p.measurement_timeout_ns
    )


def is_stale(p: Supervision, x: ModeState, evidence: Evidence, now_ns: int) -> bool:
    """Whether the newest measurement is too old to steer by."""
    return not is_fresh(p, x, evidence, now_ns)


def is_trusted(p: Supervision, x: ModeState, evidence: Evidence, now_ns: int) -> bool:
    """Whether measurements are fresh again, enough of them good, and nothing else is wrong."""
    is_back = x.good_run >= p.recovery_frames and is_fresh(p, x, evidence, now_ns)
    return is_back and evidence.goes_forward and not evidence.own_fault


def is_not_forward(_p: Supervision, _x: ModeState, evidence: Evidence, _now_ns: int) -> bool:
    """Whether the vehicle stands or reverses, and no law may steer."""
    return not evidence.goes_forward


def is_at_fault(_p: Supervision, _x: ModeState, evidence: Evidence, _now_ns: int) -> bool:
    """Whether the controller has detected a fault in itself."""
    return evidence.own_fault


def is_held_enough(p: Supervision, x: ModeState, _evidence: Evidence, now_ns: int) -> bool:
    """Whether the mode has lasted for the hold time."""
    return now_ns - x.entered_ns >= p.hold_ns


def is_law_failed(_p: Supervision, _x: ModeState, evidence: Evidence, _now_ns: int) -> bool:
    """Whether the law's command was not finite."""
    return evidence.law_failed


TRANSITIONS: Mapping[Mode, tuple[tuple[Guard, Mode], ...]] = {
    Mode.WAITING: ((is_fresh, Mode.ACTIVE),),
    Mode.ACTIVE: (
        (is_at_fault, Mode.SAFE_STOP),
        (is_law_failed, Mode.HOLDING),
        (is_stale, Mode.HOLDING),
        (is_not_forward, Mode.HOLDING),
    ),
    Mode.HOLDING: (
        (is_at_fault, Mode.SAFE_STOP),
        (is_trusted, Mode.ACTIVE),
        (is_held_enough, Mode.SAFE_STOP),
    ),
    Mode.SAFE_STOP: ((is_trusted, Mode.ACTIVE),),
}


def mode_step(p: Supervision, x: ModeState, evidence: Evidence, now_ns: int) -> ModeState:
    """Take at most one transition of the table; returns the state that holds from ``now_ns`` on.

    A hold begins without good measurements.
    """
    for guard, following in TRANSITIONS[x.mode]:
        if guard(p, x, evidence, now_ns):
            return ModeState(following, now_ns, 0 if following is Mode.HOLDING else x.good_run)
    return x


def measured_run(p: Supervision, good_run: int, before_ns: int | None, now_ns: int) -> int:
    """Return the run after a good measurement; one after a gap starts a new run.

    ``before_ns``  when the previous one arrived, None for the first [ns]
    """
    continues = before_ns is not None and now_ns - before_ns <= p.measurement_timeout_ns
    return good_run + 1 if continues else 1


def damaged_run(good_run: int) -> int:
    """Return the run after a damaged measurement, which cancels a good one."""
    return max(good_run - 1, 0)


_ACTIVE = Mode.ACTIVE


class Supervisor:
    """Keeps the mode, and the number of good measurements.

    ``start_ns``  when WAITING begins [ns]

    ``goes_forward``  whether the vehicle does, as far as is known
    ``is_silent``     whether the controller may not steer, because there is a second sender
    ``has_own_fault`` whether it has detected a fault in itself, which is permanent
    """

    def __init__(self, supervision: Supervision, start_ns: int) -> None:
        self._supervision = supervision
        self._timeout_ns = supervision.measurement_timeout_ns
        self._entered_ns = start_ns
        self.mode = Mode.WAITING
        self._good_run = 0
        self.has_own_fault = False
        self.goes_forward = True
        self.is_silent = False

    def stays_active(self, arrival_ns: int | None, now_ns: int) -> bool:
        """Whether the mode is ACTIVE and no guard of the table's is true: the usual case.

        ``arrival_ns``  when the newest good measurement arrived, None before the first [ns]
        """
        return (
            self.mode is _ACTIVE
            and arrival_ns is not None
            and now_ns - arrival_ns <= self._timeout_ns
            and self.goes_forward
            and not self.is_silent
            and not self.has_own_fault
        )

    def on_measurement(self, before_ns: int | None, now_ns: int) -> None:
        """Record a good measurement; ``before_ns`` as in ``measured_run``."""
        self._good_run = measured_run(self._supervision, self._good_run, before_ns, now_ns)

    def on_rejection(self) -> None:
        """Record a damaged measurement."""
        self._good_run = damaged_run(self._good_run)

    def move_on(
        self, arrival_ns: int | None, now_ns: int, *, law_failed: bool = False
    ) -> Mode | None:
        """Take at most one transition; returns the mode entered, None for no change.

        ``arrival_ns``  when the newest good measurement arrived, None before the first [ns]
        """
        before = ModeState(self.mode, self._entered_ns, self._good_run)
        may_steer = self.goes_forward and not self.is_silent
        evidence = Evidence(arrival_ns, law_failed, self.has_own_fault, may_steer)
        after = mode_step(self._supervision, before, evidence, now_ns)
        if after is before:
            return None
        self.mode, self._entered_ns, self._good_run = after
        return self.mode
