"""The compiled loop of one run: plant events and control ticks in the order of virtual time.

At one instant (``runtime.node.virtual_time_loop`` with the nodes plant, controller and no time on
the wire):

1. commands that were sent earlier and are due now reach the actuator
2. the sensors sample
3. the controller decides on the newest measurement that has arrived, and sends
4. that command reaches the actuator, if its latency is zero

Which measurement is in use at which tick, which command comes through and when, and which mode the
controller is in follow from the latencies alone and are computed beforehand
(``closed_loop.compiled.schedule``).

The functions here are compiled at their first call, after
``closed_loop.compiled.step_functions.register_steps``.
"""

import math
from typing import Any

import numpy as np
from numba.extending import register_jitable

from ...controller.law_interface import NO_HISTORY, VehicleReading
from ...controller.limits.fades_and_ramps import difference_step, ramp_step
from ...controller.limits.steer_limits import limit_step
from ...dbc.messages import Mode
from ...plant_emulator.steering.hand_wheel import driver_steers
from ...plant_emulator.steering.hold_and_fallback import (
    NO_PATH,
    GuardMode,
    GuardState,
    PathSeen,
    guard_command,
    guard_timer,
    guard_wheel,
    is_overruled,
    start_guard,
)
from .compilation import compiled_unchecked
from .hand_wheel import (
    NO_TURN,
    READS,
    STEERS,
    after_event,
    decide,
    is_drivers,
    next_ns,
    read_force,
    start_wheel,
    turn_of,
    wanted_rad,
)
from .inlined_functions import INLINE
from .law_code import NO_OUTPUT, LawCode
from .law_input import (
    LATERAL_ERROR_M_MAX,
    LATERAL_ERROR_RESOLUTION_M,
    STEER_RESOLUTION_RAD,
    carries_plan,
    curvature_on_wire_1_m,
    known_now,
    limit_plan_of,
    play,
    quantised,
    record_ahead,
    record_driver,
    record_signals,
    speed_on_wire_m_s,
    take_arrivals,
    wheel_on_wire_rad,
    with_command,
)
from .loop_records import (
    ARC_LENGTH,
    CURVATURE,
    DUE_NS,
    ERROR,
    HEADING,
    LAW_OUTPUT,
    MEASURED,
    NOTHING_KNOWN,
    NOW_UNKNOWN,
    OVERRULED,
    SENT,
    SENT_AT,
    SPEED,
    STATE_IS_STALE,
    STATE_SAMPLE,
    STATUS_SAMPLE,
    TICK_NS,
    TICK_SAMPLE,
    WAITING,
    WHEEL,
    YAW_RATE,
    Constants,
    Inbox,
    Instants,
    Kept,
    Now,
    Progress,
    Records,
    Segment,
)
from .memory import at, called, placed, read, write
from .step_functions import (
    advance_motion,
    brake_motion,
    chosen_by_type,
    command_motion,
    place_of,
    record_tyres,
    register,
    start_motion,
)

register(limit_step, difference_step, ramp_step, is_overruled, driver_steers)
register(start_guard, guard_command, guard_timer, guard_wheel)

COMPLETE, LEFT_RANGE, LAW_FAILED, IS_OVERRULED, SPEED_CHANGED, TAKEN_OVER = range(6)
"""How a segment ended: complete; with an error that LATERAL_ERROR cannot carry; with a command that
is not finite; with one that the steering overrules, in a run without the status in use; with a
speed that the controller did not know before, at a tick that is to be run once more; with the law
that steers in the driver's place from the next tick on."""

_ACTIVE, _SAFE_STOP, _WAITING = int(Mode.ACTIVE), int(Mode.SAFE_STOP), int(Mode.WAITING)
_HOLDING, _FALLBACK = int(GuardMode.HOLDING), int(GuardMode.FALLBACK)
_NEWEST = WAITING - 1

_KNOWN = {Inbox: lambda _: NOTHING_KNOWN, None: lambda _: None}
_RINGS = {Inbox: lambda inbox: inbox.rings, None: lambda _: NO_HISTORY}
_nothing_known, _rings = chosen_by_type(_KNOWN.get), chosen_by_type(_RINGS.get)
"""(inbox): returns the knowledge at the start, and the history that laws read."""


# For a record without waiting commands these tests are decided when compiling.
@register_jitable(**INLINE)
def _has_waited(waiting: Any, waited: tuple[int, int, int]) -> bool:
    """Whether a command is due in the motion; ``waited``: next, after the last, up to when [ns]."""
    if waiting is None:
        return False
    acting, given, to_ns = waited
    return bool(acting < given and waiting.due_ns[np.uintp(acting & _NEWEST)] <= to_ns)


@register_jitable(**INLINE)
def _waiting_at(waiting: Any, acting: int) -> tuple[int, float]:
    """Return when a command is due, and its steer."""
    if waiting is None:
        return 0, 0.0
    turn = np.uintp(acting & _NEWEST)
    return waiting.due_ns[turn], waiting.steer_rad[turn]


@register_jitable(**INLINE)
def _waits(waiting: Any, given: int, due_ns: int, steer_rad: float) -> bool:
    """Let a command wait, where the actuator has a dead time; returns whether it does."""
    if waiting is None:
        return False
    turn = np.uintp(given & _NEWEST)
    waiting.due_ns[turn], waiting.steer_rad[turn] = due_ns, steer_rad
    return True


@register_jitable(**INLINE)
def _plant_until(
    p: Any,
    c: Constants,
    s: Instants,
    r: Records,
    inbox: Any,
    wheel: Any,
    x: Progress,
    ticks_done: int,
    to_ns: int,
) -> tuple[Progress, int]:
    """Apply the commands of the ticks done, and take samples, up to and at ``to_ns``."""
    (
        z, guard, followed_ns, sample, command, in_effect,
        plan, is_new, played, given, acting, hands,
    ) = x  # fmt: skip
    outcome = COMPLETE
    while outcome == COMPLETE:
        command_ns = sample_ns = to_ns + 1
        # An unsigned index needs no test for negative values, which would cost a twentieth.
        of, at = np.uintp(command), np.uintp(sample)
        if command < s.commands.shape[1] and s.commands[SENT_AT, of] < ticks_done:
            command_ns = s.commands[DUE_NS, of]
        if sample < len(s.sample_ns):
            sample_ns = s.sample_ns[at]
        guard_ns = c.motion_start_ns + guard.deadline_ns
        wheel_ns = to_ns + 1 if wheel is None else next_ns(wheel, hands, ticks_done, to_ns)
        first_ns = min(command_ns, sample_ns, guard_ns)
        if wheel is not None:
            first_ns = min(first_ns, wheel_ns)
        waited = acting, given, min(first_ns, to_ns) - c.motion_start_ns
        has_waited = _has_waited(r.waiting, waited)
        if first_ns > to_ns and not has_waited:
            break
        turn = NO_TURN
        if wheel is not None and wheel_ns <= to_ns:
            times = command_ns, min(sample_ns, guard_ns)
            turn = turn_of(wheel, hands, wheel_ns, command, times)
        turns_wheel = turn == STEERS
        arrives = command_ns <= sample_ns and command_ns <= guard_ns and turn == NO_TURN
        plays = plan >= 0 and not arrives and sample_ns < guard_ns and played != sample
        has_moved, is_sample, steers, acts, steer_rad = True, False, False, False, 0.0
        if has_waited:
            motion_ns, steer_rad = _waiting_at(r.waiting, acting)
            acts, acting = True, acting + 1
        elif wheel is not None and turn > STEERS:
            motion_ns = wheel_ns - c.motion_start_ns
            if turn == READS:
                z = advance_motion(p, z, motion_ns)
                read_force(wheel, hands, p, z)
            hands = after_event(wheel, r, hands, wheel_ns)
            continue
        # The test for an inbox is decided when compiling, which removes the branch without one.
        elif arrives or (wheel is not None and turns_wheel) or (inbox is not None and plays):
            at_ns, by, has_come, command_rad = sample_ns, plan, is_new, math.nan
            if wheel is not None and turns_wheel:
                at_ns, by, has_come = wheel_ns, in_effect, True
                command_rad = wanted_rad(wheel, hands)
                hands = after_event(wheel, r, hands, wheel_ns)
            elif arrives:
                at_ns, by, has_come = command_ns, command, True
                command += 1
                plan, is_new = -1, False
                tick = s.commands[SENT_AT, of]
                if inbox is not None and carries_plan(inbox, tick):
                    plan, is_new = by, True
                    continue
                command_rad = quantised(r.ticks[SENT, np.uintp(tick)], STEER_RESOLUTION_RAD)
            elif inbox is not None:
                is_new, played = False, sample
                command_rad = play(inbox, sample)
                if not math.isfinite(command_rad):
                    plan = -1
                    continue
            motion_ns = max(at_ns - c.motion_start_ns, 0)
            is_echoed = False
            if wheel is not None and not turns_wheel:
                is_echoed = driver_steers(hands.plant, at_ns)
            if not is_echoed:
                guard, steers = guard_command(c.guard, guard, command_rad, motion_ns, has_come)
            if steers or is_echoed:
                in_effect = by
                if inbox is not None and not (arrives or turns_wheel):
                    inbox.played_rad[at] = command_rad
            if is_echoed:
                continue
        elif guard_ns <= sample_ns:
            motion_ns = guard.deadline_ns
            seen = NO_PATH
            if sample > 0:
                last = np.uintp(sample - 1)
                read = r.samples
                seen = PathSeen(read[CURVATURE, last], read[ERROR, last], read[HEADING, last])
            guard, steers = guard_timer(c.guard, guard, motion_ns, seen)
            has_moved = steers
        else:
            motion_ns = max(sample_ns - c.motion_start_ns, 0)
            is_sample = True
        # One call of each for all of them: they are compiled inline wherever they stand.
        if has_moved:
            z = advance_motion(p, z, motion_ns)
        if steers:
            if c.stop_m_s2 > 0.0:
                z = brake_motion(p, z, c.stop_m_s2 if guard.mode >= _FALLBACK else 0.0)
            steer_rad = guard.limiter.steer_rad
            acts = not _waits(r.waiting, given, motion_ns + p.dead_time_ns, steer_rad)
            given += 1
        if acts:
            z = command_motion(p, z, steer_rad)
        if is_sample:
            sampled = z, guard, followed_ns, sample, in_effect, hands
            guard, followed_ns, outcome = _take_sample(p, c, s, r, inbox, wheel, sampled, motion_ns)
            sample += 1
    buffered = plan, is_new, played, given, acting, hands
    return Progress(z, guard, followed_ns, sample, command, in_effect, *buffered), outcome


@register_jitable(**INLINE)
def _with_hands(x: Progress, hands: Any) -> Progress:
    z, guard, followed_ns, sample, command, in_effect, plan, is_new, played, given, acting, _ = x
    buffered = plan, is_new, played, given, acting, hands
    return Progress(z, guard, followed_ns, sample, command, in_effect, *buffered)


@register_jitable(**INLINE)
def _take_sample(
    p: Any,
    c: Constants,
    s: Instants,
    r: Records,
    inbox: Any,
    wheel: Any,
    sampled: tuple[Any, GuardState, int, int, int, Any],
    motion_ns: int,
) -> tuple[GuardState, int, int]:
    """Record a sample; returns the guard, when the wheel followed last, and an outcome."""
    z, before, followed_before_ns, sample, in_effect, hands = sampled
    _, linear, _ = z
    _, yaw_rate_rad_s, heading_rad, error_m, wheel_rad, _, curvature_1_m, _, _, _ = linear
    guard, followed_ns = guard_wheel(c.guard, before, followed_before_ns, wheel_rad, motion_ns)
    at = np.uintp(sample)
    r.samples[ERROR, at], r.samples[HEADING, at] = error_m, heading_rad
    r.samples[YAW_RATE, at], r.samples[WHEEL, at] = yaw_rate_rad_s, wheel_rad
    r.samples[CURVATURE, at] = curvature_1_m
    arc_length_m, speed_m_s = place_of(p, z)
    r.samples[ARC_LENGTH, at], r.samples[SPEED, at] = arc_length_m, speed_m_s
    record_tyres(p, z, r.samples, at)
    r.command[at] = in_effect
    reading_m = error_m + s.noise_m[at]
    if inbox is not None:
        record_signals(inbox, sample, linear, guard)
        record_ahead(inbox, p, sample, arc_length_m, speed_m_s)
    overrules = is_overruled(guard) and guard.mode != _HOLDING
    if wheel is not None:
        is_by_driver = is_drivers(hands, p, z, guard, motion_ns)
        overrules = overrules or is_by_driver
        if inbox is not None and is_by_driver:
            record_driver(inbox, sample)
    if overrules:
        if len(s.in_use) <= STATUS_SAMPLE:
            return guard, followed_ns, IS_OVERRULED
        r.samples[OVERRULED, at] = wheel_on_wire_rad(wheel_rad)
    if not abs(reading_m) <= LATERAL_ERROR_M_MAX:
        return guard, followed_ns, LEFT_RANGE
    r.samples[MEASURED, at] = quantised(reading_m, LATERAL_ERROR_RESOLUTION_M)
    return guard, followed_ns, COMPLETE


@compiled_unchecked
def run_segment(
    law: LawCode,
    p: Any,
    c: Constants,
    s: Instants,
    r: Records,
    inbox: Any,
    wheel: Any,
    segment: Segment,
    is_start: bool,
    end_ns: int,
) -> Any:
    """Run the ticks of a segment, each with the plant up to it, and the plant up to the next.

    ``is_start``  whether the plant is at its start, and not where the segment before left it
    ``end_ns``    until when to run the plant after the very last tick

    Returns the samples taken and the ticks done so far, and how it ended.
    """
    x = Progress(
        start_motion(p), start_guard(c.guard), 0, 0, 0, -1, -1, False, -1, 0, 0, start_wheel(wheel)
    )
    kept = Kept(x, 0.0, 0.0, _nothing_known(inbox))
    place = at(law.kept, kept)
    if not is_start:
        kept = read(place)
    kept, ticks, outcome = _run_ticks(law, p, c, s, r, inbox, wheel, segment, kept, end_ns)
    write(place, kept)
    return kept.plant.sample, ticks, outcome


@register_jitable(**INLINE)
def _run_ticks(
    law: LawCode,
    p: Any,
    c: Constants,
    s: Instants,
    r: Records,
    inbox: Any,
    wheel: Any,
    segment: Segment,
    kept: Kept,
    end_ns: int,
) -> tuple[Kept, int, int]:
    mode, first_tick, last_tick, is_recovery = segment
    x, sent_rad, fade_rad, known = kept
    history = placed(_rings(inbox))
    now_known = placed(NOW_UNKNOWN)
    ticks = s.ticks.shape[1]
    for tick in range(first_tick, last_tick + 1):
        now = np.uintp(tick)
        to_ns = s.ticks[TICK_NS, now] if tick < ticks else end_ns
        x, outcome = _plant_until(p, c, s, r, inbox, wheel, x, tick, to_ns)
        if outcome != COMPLETE or tick == last_tick:
            return Kept(x, sent_rad, fade_rad, known), tick, outcome
        state_sample = s.in_use[STATE_SAMPLE, now] if len(s.in_use) > STATE_SAMPLE else -1
        if state_sample >= 0 and c.alike_to_m_s < math.inf:
            newest_m_s = speed_on_wire_m_s(r.samples[SPEED, np.uintp(state_sample)])
            if newest_m_s != c.speed_m_s and max(newest_m_s, c.speed_m_s) > c.alike_to_m_s:
                return Kept(x, sent_rad, fade_rad, known), tick, SPEED_CHANGED
        if inbox is not None:
            known = take_arrivals(inbox, known, s, r, to_ns)
        steer_rad, acting = sent_rad, -1
        if mode == _ACTIVE:
            error_m = r.samples[MEASURED, np.uintp(s.ticks[TICK_SAMPLE, now])]
            if inbox is not None:
                write(now_known, known_now(inbox, known, tick, to_ns))
            elif state_sample >= 0:
                of = np.uintp(state_sample)
                speed_m_s = speed_on_wire_m_s(r.samples[SPEED, of])
                curvature_1_m = curvature_on_wire_1_m(r.samples[CURVATURE, of])
                is_stale = s.in_use[STATE_IS_STALE, now] != 0
                vehicle = VehicleReading(speed_m_s, 0.0, curvature_1_m, is_stale)
                write(now_known, Now(vehicle, NOW_UNKNOWN.loop_delay))
            acting_rad = sent_rad
            if len(s.in_use) > STATUS_SAMPLE and s.in_use[STATUS_SAMPLE, now] >= 0:
                # As ``controller.node.newest_messages.acting_rad``.
                overruled_rad = r.samples[OVERRULED, np.uintp(s.in_use[STATUS_SAMPLE, now])]
                acting_rad = overruled_rad if math.isfinite(overruled_rad) else sent_rad
            observed = (law.params, law.state, history, now_known, error_m, acting_rad)
            output = called(law.step, NO_OUTPUT, observed)
            asked_rad = (c.share if to_ns >= c.share_from_ns else 1.0) * output.steer_rad
            if not math.isfinite(asked_rad):
                return Kept(x, sent_rad, fade_rad, known), tick, LAW_FAILED
            continues_hold = is_recovery and tick == first_tick
            fade_rad = difference_step(
                c.ramp_step_rad, fade_rad, sent_rad, asked_rad, continues_hold
            )
            if law.plan != 0 and fade_rad == 0.0:
                acting = called(law.plan, acting, observed)
            steer_rad = asked_rad + fade_rad
            r.ticks[LAW_OUTPUT, now] = output.steer_rad
            r.ticks[LAW_OUTPUT + 1, now] = output.disturbance_rad
            r.ticks[LAW_OUTPUT + 2, now] = output.network_disturbance_rad
            r.ticks[LAW_OUTPUT + 3, now] = output.compensated_lateral_error_m
        else:
            for row in range(LAW_OUTPUT, LAW_OUTPUT + 4):
                r.ticks[row, now] = r.ticks[row, tick - 1]
            if mode == _SAFE_STOP:
                steer_rad = ramp_step(c.ramp_step_rad, steer_rad)
        takes_over = False
        if wheel is not None:
            decided = decide(wheel, r, x.hands, tick, to_ns, (steer_rad, sent_rad, mode == _ACTIVE))
            hands, steer_rad, takes_over = decided
            x = _with_hands(x, hands)
        sent_rad = limit_step(c.limits, sent_rad, steer_rad)
        r.ticks[SENT, now] = sent_rad
        if inbox is not None and mode != _WAITING:
            if acting >= 0:
                limit_plan_of(inbox, c.limits, acting, tick)
            known = with_command(inbox, known, tick, sent_rad, acting >= 0)
        if takes_over:
            return Kept(x, sent_rad, 0.0, known), tick + 1, TAKEN_OVER
    return Kept(x, sent_rad, fade_rad, known), last_tick, COMPLETE
