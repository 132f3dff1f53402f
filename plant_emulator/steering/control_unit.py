"""The steering's control unit, behind the latency line: its target, its status, its counts."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

from ...dbc.messages import SafetyState, SteeringStatusCode
from ...runtime.node import NEVER_NS, NS_PER_S
from .hold_and_fallback import (
    GuardMode,
    GuardParams,
    GuardState,
    PathSeen,
    guard_command,
    guard_fault,
    guard_rejection,
    guard_timer,
    guard_wheel,
    is_overruled,
    start_guard,
)
from .safety_limiter import Cause

_NORMAL = SafetyState.NORMAL
_STATES = (_NORMAL, _NORMAL, SafetyState.HOLDING, SafetyState.FALLBACK, SafetyState.SAFE_STATE)
"""State in PLANT_STATUS for each ``GuardMode`` if nothing was limited."""
_STATUS_CODES = tuple(SteeringStatusCode)
_CODES = (
    int(SteeringStatusCode.NO_COMMAND),
    int(SteeringStatusCode.APPLYING),
    int(SteeringStatusCode.HOLDING),
    int(SteeringStatusCode.FALLBACK),
    int(SteeringStatusCode.SAFE_STATE),
)
"""Code in STEERING_STATUS for each ``GuardMode`` if nothing limits the command."""
_FOLLOWING, _FALLBACK = int(GuardMode.FOLLOWING), int(GuardMode.FALLBACK)
_LIMITED = int(SteeringStatusCode.LIMITED)
_LIMITED_BY_SAFETY = int(SteeringStatusCode.LIMITED_BY_SAFETY)


def status_of(x: GuardState, actuator_is_limited: bool) -> int:
    """Return the present code of STEERING_STATUS."""
    mode = x.mode
    if mode == _FOLLOWING:
        if is_overruled(x):
            return _LIMITED_BY_SAFETY
        if actuator_is_limited:
            return _LIMITED
    return _CODES[mode]


class SteeringUnit:
    """Holds the guard's state; all times are of motion [ns].

    ``limit``        the name of the limit that decides about the target now; empty for none
    ``interventions``  targets that a limit has changed, by the limit that decided
    ``safety``       what PLANT_STATUS would say now: LIMITING after any intervention since the last
    """

    def __init__(self, params: GuardParams) -> None:
        self._params = params
        self._state: GuardState = start_guard(params)
        self.interventions: Counter[str] = Counter()
        self._entered: Counter[str] = Counter()
        self._ignored = 0
        self._recoveries = 0
        self._command_ns, self._wheel_ns, self._followed_ns = NEVER_NS, 0, 0
        self._longest_silence_ns = 0
        self._safe_state_at_ns = NEVER_NS
        self._safe_state_cause = ""
        self._limited_since_report = False
        self._enter(self._state)

    @property
    def mode(self) -> GuardMode:
        """What determines the target."""
        return GuardMode(self._state.mode)

    @property
    def stops(self) -> bool:
        """Whether the fallback brakes now, where the settings let it."""
        return self._state.mode >= _FALLBACK

    @property
    def has_fallen_back(self) -> bool:
        """Whether the target has reached the end of SAFE_STATE's fallback."""
        is_kept = self._params.ramp_step_rad == 0.0
        return self.mode is GuardMode.SAFE_STATE and (is_kept or self.target_rad == 0.0)

    def on_command(self, steer_rad: float, now_ns: int, is_new: bool = True) -> bool:
        """Process a command; returns whether it sets the target.

        ``is_new``  whether it has just arrived, and is no later value of a plan
        """
        before = self._state
        state, is_followed = guard_command(self._params, before, steer_rad, now_ns, is_new)
        if is_new:
            if now_ns - self._command_ns > self._longest_silence_ns:
                self._longest_silence_ns = now_ns - self._command_ns
            self._command_ns = now_ns
        if not is_followed:
            self._ignored += is_new
        elif before.mode > _FOLLOWING and state.mode == _FOLLOWING:
            self._recoveries += 1
        self._enter(state, is_followed)
        return is_followed

    def on_rejection(self) -> None:
        """Process a damaged command."""
        self._state = guard_rejection(self._state)

    def on_timer(self, now_ns: int, seen: PathSeen) -> bool:
        """Do what is due; returns whether it sets the target."""
        state, is_set = guard_timer(self._params, self._state, now_ns, seen)
        self._note_mode(state, now_ns, "override")
        self._enter(state, is_set)
        return is_set

    def on_wheel(self, wheel_rad: float, now_ns: int) -> None:
        """Compare the measured wheel with the target."""
        before, self._wheel_ns = self._state, now_ns
        state, self._followed_ns = guard_wheel(
            self._params, before, self._followed_ns, wheel_rad, now_ns
        )
        if state is not before:
            self._note_mode(state, now_ns, "the wheel does not follow")
            self._enter(state)

    def on_own_fault(self, cause: str, now_ns: int) -> None:
        """Go to SAFE_STATE for good, because the plant is no longer reliable."""
        state = guard_fault(self._state, now_ns)
        self._note_mode(state, now_ns, cause)
        self._enter(state)

    def status_code(self, actuator_is_limited: bool) -> SteeringStatusCode:
        """Return the present content of STEERING_STATUS."""
        return _STATUS_CODES[status_of(self._state, actuator_is_limited)]

    def take_state(self) -> SafetyState:
        """Return the content of PLANT_STATUS."""
        reported = self.safety
        self._limited_since_report = False
        self._enter(self._state)
        return reported

    def report(self) -> Mapping[str, Any]:
        """Return the guard's figures, ready for JSON.

        ``interventions``      targets that a limit has changed, by limit
        ``ignored_commands``   commands that arrived while none was followed
        ``longest_silence_s``  after a command that arrived: to the next, or to the newest sample
        ``safe_state``         cause and time; None if it was not entered
        """
        at_ns = self._safe_state_at_ns
        is_safe, silence_ns = at_ns != NEVER_NS, self._wheel_ns - self._command_ns
        return {
            "mode": self.mode.name.lower(),
            "interventions": dict(sorted(self.interventions.items())),
            "holdings": self._entered["HOLDING"],
            "fallbacks": self._entered["FALLBACK"],
            "recoveries": self._recoveries,
            "ignored_commands": self._ignored,
            "longest_silence_s": max(self._longest_silence_ns, silence_ns) / NS_PER_S,
            "safe_state": {"cause": self._safe_state_cause, "at_s": at_ns / NS_PER_S}
            if is_safe
            else None,
        }

    def _enter(self, state: GuardState, is_set: bool = False) -> None:
        """Keep a state, and what is read of it at every event of the plant.

        ``is_set``  whether its target has just been set
        """
        self._state = state
        mode, (self.target_rad, cause, *_), _, self.deadline_ns, _, _, _ = state
        self.limit = ""
        if cause:
            name = Cause(cause).name.lower()
            if mode == _FOLLOWING:
                self.limit = name
            if is_set:
                self.interventions[name] += 1
                self._limited_since_report = True
        safety = _STATES[mode]
        if self._limited_since_report and safety is _NORMAL:
            safety = SafetyState.LIMITING
        self.safety = safety

    def _note_mode(self, state: GuardState, now_ns: int, cause: str) -> None:
        if state.mode == self._state.mode:
            return
        mode = GuardMode(state.mode)
        self._entered[mode.name] += 1
        if mode is GuardMode.SAFE_STATE:
            self._safe_state_at_ns, self._safe_state_cause = now_ns, cause
