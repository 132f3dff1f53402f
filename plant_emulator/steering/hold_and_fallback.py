"""Hold and fallback: which command the wheel follows, and what replaces it in silence.

    mode         the wheel's target                                  until
    NO_COMMAND   straight                                            the first command
    FOLLOWING    the newest command, within the safety limits        silence: HOLDING
    HOLDING      the last command or plan; each new command, faded   recovery, or ``hold_ns`` of
                                                                     silence: FALLBACK
    FALLBACK     ramps to zero, is kept, or follows the path         recovery
    SAFE_STATE   as FALLBACK, whatever arrives                       the end of the run

Silence is the time since the last command arrived at the actuator, behind the latency line, where a
steering's control unit is. The unit cannot distinguish a network that delays or loses commands from
a controller that has stopped. A sudden rise of the latency by 200 ms is a silence of 200 ms.

Only the first value of a plan counts as a command that arrives. The later ones move the target for
``plan_ns`` and until FALLBACK, and a fade goes on with them; they neither delay the reaction to
silence nor count as recovery.

Recovery takes ``recovery_frames`` commands without such a silence between them, and one more for
each damaged frame among them. The target never jumps: its difference to the first command
followed is added to the command and fades out at the ramp rate.
After FALLBACK that is the command that completes the recovery. In HOLDING it is the first one to
arrive: jitter with overtaking causes such gaps all the time, and waiting for a run of commands
after each would add to the delay. Another silence before the recovery restarts the run, and the
fade from its present value.

The clock of ``hold_ns`` stops while the newest command is younger than ``silence_ns`` and damaged
frames have not used up the run. Only the end of HOLDING resets it, so that occasional single
commands end in FALLBACK. SAFE_STATE is entered if the wheel does not follow its target, if the
plant has detected a fault in itself, or by the override, and stays.

The unit follows the path by itself, on what its sensors read last of deviation y, heading error Δψ
and curvature ρ at the preview point: δ = (L + K V²)(ρ − y/ℓ² − 2 Δψ/ℓ), which is stable for a way ℓ
that is long against the actuator's lag.

Every target, also of a ramp, passes ``plant_emulator.steering.safety_limiter``. Times count from
the start of motion.
"""

from enum import IntEnum
from typing import NamedTuple

from ...runtime.fast_named_tuple import new_record
from .safety_limiter import LimiterParams, LimiterState, is_at_target, limit_steer, start_limiter

RAMP_PERIOD_NS = 10_000_000
"""Interval of the steps that form a ramp of the target."""
OFF_NS = 1 << 62
"""A time that never comes, and does not overflow when another is added."""


class GuardMode(IntEnum):
    """What determines the wheel's target."""

    NO_COMMAND = 0
    FOLLOWING = 1
    HOLDING = 2
    FALLBACK = 3
    SAFE_STATE = 4


_NO_COMMAND, _FOLLOWING, _HOLDING, _FALLBACK, _SAFE_STATE = map(int, GuardMode)


class GuardParams(NamedTuple):
    """Parameters of the guard.

    ``silence_ns``       time without a command that counts as silence; OFF_NS: none does
    ``plan_ns``          how long a plan is played after it has come
    ``hold_ns``          time of silence from HOLDING to FALLBACK
    ``recovery_frames``  by how many commands must outnumber damaged frames to end either
    ``ramp_rad_s``       of the fade after a recovery
    ``ramp_step_rad``    of the ramp to zero, every RAMP_PERIOD_NS; 0: the target is kept
    ``override_ns``      when SAFE_STATE is forced; OFF_NS: never
    ``path_m``           L + K V² of a fallback along the path; 0: it is another
    ``path_1_m``         1/ℓ
    """

    limiter: LimiterParams
    silence_ns: int
    plan_ns: int
    hold_ns: int
    recovery_frames: int
    ramp_rad_s: float
    ramp_step_rad: float
    override_ns: int
    path_m: float = 0.0
    path_1_m: float = 0.0


class PathSeen(NamedTuple):
    """What the sensors read of the path last."""

    curvature_1_m: float
    lateral_error_m: float
    heading_error_rad: float


NO_PATH = PathSeen(0.0, 0.0, 0.0)


class GuardState(NamedTuple):
    """State of the guard; the target is ``limiter.steer_rad``.

    ``arrived_ns``   when the newest command arrived
    ``deadline_ns``  when `guard_timer` is due next
    ``good_run``     commands in a row towards recovery, the newest included; 0 after a damaged one
    ``fade_rad``     what was added to the newest command or value of a plan
    ``faded_ns``     when that was: the fade goes on from there
    """

    mode: int
    limiter: LimiterState
    arrived_ns: int
    deadline_ns: int
    good_run: int
    fade_rad: float
    faded_ns: int


def start_guard(p: GuardParams) -> GuardState:
    """Return the state at time 0."""
    return GuardState(_NO_COMMAND, start_limiter(), 0, p.override_ns, 0, 0.0, 0)


def guard_command(
    p: GuardParams, x: GuardState, steer_rad: float, time_ns: int, is_new: bool = True
) -> tuple[GuardState, bool]:
    """Process a command; returns the state and whether the command is followed.

    ``is_new``  whether it has just arrived, and is no later value of a plan
    """
    before, limiter, arrived_ns, deadline_ns, run_before, fade_before_rad, faded_ns = x
    silent_ns, override_ns = p.silence_ns, p.override_ns
    if before == _SAFE_STATE:
        return x, False
    fade_rad = fade_before_rad
    if fade_rad:
        fading_ns = min(time_ns - faded_ns, silent_ns)
        fade_rad = _towards_zero(fade_rad, p.ramp_rad_s * (fading_ns * 1e-9))
    if not is_new:
        if before == _FALLBACK or time_ns - arrived_ns > p.plan_ns:
            return x, False
        limiter, _ = limit_steer(p.limiter, limiter, steer_rad + fade_rad, time_ns)
        state = GuardState(before, limiter, arrived_ns, deadline_ns, run_before, fade_rad, time_ns)
        return state, True
    silence_ns = time_ns - arrived_ns
    mode, good_run = before, run_before + 1 if silence_ns < silent_ns else 1
    if before <= _FOLLOWING or good_run >= p.recovery_frames:
        mode, good_run = _FOLLOWING, 0
        deadline_ns = time_ns + silent_ns
        if deadline_ns > override_ns:
            deadline_ns = override_ns
    elif before == _FALLBACK:
        return GuardState(before, limiter, time_ns, deadline_ns, good_run, 0.0, time_ns), False
    elif run_before > 0:
        deadline_ns = min(deadline_ns + min(silence_ns, silent_ns), override_ns)
    wanted_rad = steer_rad + fade_rad
    if before == _FALLBACK or (before == _HOLDING and silence_ns >= silent_ns):
        wanted_rad = limiter.steer_rad + (fade_rad - fade_before_rad)
        fade_rad = wanted_rad - steer_rad
    limiter, _ = limit_steer(p.limiter, limiter, wanted_rad, time_ns)
    after = (mode, limiter, time_ns, deadline_ns, good_run, fade_rad, time_ns)
    return new_record(GuardState, after), True


def guard_rejection(x: GuardState) -> GuardState:
    """Process a damaged command, which cancels a good one of the run."""
    return x._replace(good_run=max(x.good_run - 1, 0))


def guard_timer(
    p: GuardParams, x: GuardState, time_ns: int, seen: PathSeen = NO_PATH
) -> tuple[GuardState, bool]:
    """Do what is due at ``deadline_ns``; returns the state and whether the target is set."""
    mode, limiter, arrived_ns, _, good_run, fade_rad, faded_ns = x
    if time_ns >= p.override_ns:
        mode = _SAFE_STATE
    elif mode == _FOLLOWING:
        until_ns = min(time_ns + p.hold_ns, p.override_ns)
        return GuardState(_HOLDING, limiter, arrived_ns, until_ns, 1, fade_rad, faded_ns), False
    elif mode == _HOLDING:
        mode = _FALLBACK
    target_rad = _towards_zero(limiter.steer_rad, p.ramp_step_rad)
    if p.path_m > 0.0:
        rho, y, psi = seen
        target_rad = p.path_m * (rho - p.path_1_m * (p.path_1_m * y + 2.0 * psi))
    limiter, target_rad = limit_steer(p.limiter, limiter, target_rad, time_ns)
    next_ns = OFF_NS
    if p.path_m > 0.0 or (target_rad != 0.0 and p.ramp_step_rad > 0.0):
        next_ns = time_ns + RAMP_PERIOD_NS
    if mode != _SAFE_STATE:
        next_ns = min(next_ns, p.override_ns)
    return GuardState(mode, limiter, arrived_ns, next_ns, good_run, 0.0, time_ns), True


def guard_fault(x: GuardState, time_ns: int) -> GuardState:
    """Process a fault: SAFE_STATE, and `guard_timer` is due at once."""
    if x.mode == _SAFE_STATE:
        return x
    return GuardState(_SAFE_STATE, x.limiter, x.arrived_ns, time_ns, 0, 0.0, time_ns)


def guard_wheel(
    p: GuardParams, x: GuardState, followed_ns: int, wheel_rad: float, time_ns: int
) -> tuple[GuardState, int]:
    """Process a measured wheel angle; `guard_timer` is due at once if the wheel does not follow.

    ``followed_ns``  when the wheel was last within its tolerance; its new value is returned
    """
    limiter = p.limiter
    if is_at_target(limiter, x.limiter.steer_rad, wheel_rad):
        return x, time_ns
    if time_ns - followed_ns > limiter.follow_ns:
        x = guard_fault(x, time_ns)
    return x, followed_ns


def is_overruled(x: GuardState) -> bool:
    """Whether the target differs from the newest command: held, ramped, faded or limited."""
    mode = x.mode
    if mode == _FOLLOWING:
        return x.fade_rad != 0.0 or x.limiter.cause != 0
    return mode > _FOLLOWING


def _towards_zero(value: float, step: float) -> float:
    return value - min(max(value, -step), step)
