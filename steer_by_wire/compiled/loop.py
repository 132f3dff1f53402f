"""The compiled loop of one run: plant events and control ticks in the order of virtual time.

At one instant (``runtime.virtual_time`` with the nodes plant, controller and no time on the wire):

1. commands that were sent earlier and are due now reach the actuator
2. the sensors sample
3. the controller decides on the newest measurement that has arrived, and sends
4. that command reaches the actuator, if its latency is zero

Which measurement is in use at which tick, which command comes through and when, and which mode the
controller is in follow from the latencies alone and are computed beforehand (``compiled.plan``).

The functions here are compiled at their first call, after ``compiled.steps.register_steps``.
"""

import math
from typing import Any

import numpy as np

from ..controller.limits import limit_step, ramp_step
from ..dbc.messages import Mode
from ..plant_emulator.motion import advance_motion, command_motion, start_motion
from ..plant_emulator.steering_guard import (
    guard_command,
    guard_timer,
    guard_wheel,
    start_guard,
)
from .borrowing import borrowed
from .compilation import compiled, compiled_inline
from .loop_records import Constants, Control, Progress, Records, Schedule, Segment
from .steps import law_plan, law_step
from .wire import (
    carries_plan,
    law_input,
    on_wire,
    play,
    record_played,
    record_wire,
    take_arrivals,
    take_command,
    write_plan,
)

COMPLETE, LEFT_RANGE, LAW_FAILED = range(3)
"""How a segment ended: complete; with an error that LATERAL_ERROR cannot carry; with a command that
is not finite."""

_ACTIVE, _SAFE_STOP = int(Mode.ACTIVE), int(Mode.SAFE_STOP)


@compiled_inline
def _plant_until(
    p: Any,
    c: Constants,
    s: Schedule,
    r: Records,
    wire: Any,
    x: Progress,
    ticks_done: int,
    to_ns: int,
) -> tuple[Progress, int]:
    """Apply the commands of the ticks done, and take samples, up to and at ``to_ns``."""
    z, guard, sample, command, in_effect, plan, is_new, played = x
    while True:
        command_ns = sample_ns = to_ns + 1
        # An unsigned index needs no test for negative values, which would cost a twentieth.
        of, at = np.uintp(command), np.uintp(sample)
        if command < len(s.command_due_ns) and s.command_tick[of] < ticks_done:
            command_ns = s.command_due_ns[of]
        if sample < len(s.sample_ns):
            sample_ns = s.sample_ns[at]
        guard_ns = c.motion_start_ns + guard.deadline_ns
        if command_ns > to_ns and sample_ns > to_ns and guard_ns > to_ns:
            x = Progress(z, guard, sample, command, in_effect, plan, is_new, played)
            return x, COMPLETE
        arrives = command_ns <= sample_ns and command_ns <= guard_ns
        plays = plan >= 0 and not arrives and sample_ns < guard_ns and played != sample
        if arrives or plays:
            if arrives:
                at_ns, by, has_come = command_ns, command, True
                command += 1
                tick = s.command_tick[of]
                plan, is_new = -1, False
                if carries_plan(wire, tick):
                    plan, is_new = by, True
                    continue
                on_wire_rad = on_wire(r.sent_rad[np.uintp(tick)], c.steer_resolution_rad)
            else:
                at_ns, by, has_come = sample_ns, plan, is_new
                is_new, played = False, sample
                on_wire_rad = play(wire, sample)
                if not math.isfinite(on_wire_rad):
                    plan = -1
                    continue
            motion_ns = max(at_ns - c.motion_start_ns, 0)
            z = advance_motion(p, z, motion_ns)
            guard, is_followed = guard_command(c.guard, guard, on_wire_rad, motion_ns, has_come)
            if is_followed:
                z = command_motion(p, z, guard.limiter.steer_rad)
                in_effect = by
                if not arrives:
                    record_played(wire, sample, on_wire_rad)
        elif guard_ns <= sample_ns:
            motion_ns = guard.deadline_ns
            guard, is_set = guard_timer(c.guard, guard, motion_ns)
            if is_set:
                z = advance_motion(p, z, motion_ns)
                z = command_motion(p, z, guard.limiter.steer_rad)
        else:
            motion_ns = max(sample_ns - c.motion_start_ns, 0)
            z = advance_motion(p, z, motion_ns)
            _, linear, _ = z
            _, yaw_rate_rad_s, heading_rad, error_m, wheel_rad, _, curvature_1_m, _, _, _ = linear
            guard = guard_wheel(c.guard, guard, wheel_rad, motion_ns)
            r.lateral_error_m[at] = error_m
            r.heading_error_rad[at] = heading_rad
            r.yaw_rate_rad_s[at] = yaw_rate_rad_s
            r.wheel_angle_rad[at] = wheel_rad
            r.curvature_1_m[at] = curvature_1_m
            r.command[at] = in_effect
            reading_m = error_m + s.noise_m[at]
            record_wire(wire, sample, linear, guard)
            sample += 1
            if not abs(reading_m) <= c.lateral_error_m_max:
                x = Progress(z, guard, sample, command, in_effect, plan, is_new, played)
                return x, LEFT_RANGE
            r.measured_m[at] = on_wire(reading_m, c.lateral_error_resolution_m)


@compiled
def run_to_first_tick(
    p: Any, c: Constants, s: Schedule, r: Records, wire: Any, first_tick_ns: int
) -> Any:
    """Run the plant from its start up to and at the first tick; returns samples taken, and how."""
    p, s, r, wire = borrowed(p), borrowed(s), borrowed(r), borrowed(wire)
    x, outcome = _plant_until(p, c, s, r, wire, _start(p, c), 0, first_tick_ns)
    return x.sample, outcome


@compiled
def start_run(p: Any, c: Constants) -> Any:
    """Return the plant's initial state."""
    return _start(borrowed(p), c)


@compiled_inline
def _start(p: Any, c: Constants) -> Progress:
    return Progress(start_motion(p), start_guard(c.guard), 0, 0, -1, -1, False, -1)


@compiled
def run_only_segment(
    law_params: Any,
    p: Any,
    c: Constants,
    s: Schedule,
    r: Records,
    wire: Any,
    segment: Segment,
    control: Control,
    end_ns: int,
) -> Any:
    """Run from the plant's start through a segment that lasts to the end.

    Returns the samples taken, the ticks done, and how it ended. Most runs have one segment only;
    passing the plant's state to Python and back costs as much as hundreds of ticks.
    """
    p, s, r, wire = borrowed(p), borrowed(s), borrowed(r), borrowed(wire)
    x, _, ticks, outcome = _run_ticks(
        law_params, p, c, s, r, wire, segment, _start(p, c), control, end_ns
    )
    return x.sample, ticks, outcome


@compiled
def run_segment(
    law_params: Any,
    p: Any,
    c: Constants,
    s: Schedule,
    r: Records,
    wire: Any,
    segment: Segment,
    x: Progress,
    control: Control,
    end_ns: int,
) -> Any:
    """Run the ticks of a segment, each with the plant up to it, and the plant up to the next.

    ``x``       the plant, at the first tick of the segment or before it
    ``end_ns``  until when to run the plant after the very last tick

    Returns the plant, the controller, the tick that comes next, and how it ended.
    """
    p, s, r, wire = borrowed(p), borrowed(s), borrowed(r), borrowed(wire)
    return _run_ticks(law_params, p, c, s, r, wire, segment, x, control, end_ns)


@compiled_inline
def _run_ticks(
    law_params: Any,
    p: Any,
    c: Constants,
    s: Schedule,
    r: Records,
    wire: Any,
    segment: Segment,
    x: Progress,
    control: Control,
    end_ns: int,
) -> tuple[Progress, Control, int, int]:
    mode, first_tick, last_tick, is_recovery = segment
    law_state, sent_rad, fade_rad, known = control
    # Call the plant in one place only: each call compiles all of it into this loop.
    for tick in range(first_tick, last_tick + 1):
        now = np.uintp(tick)
        to_ns = s.tick_ns[now] if tick < len(s.tick_ns) else end_ns
        x, outcome = _plant_until(p, c, s, r, wire, x, tick, to_ns)
        if outcome != COMPLETE or tick == last_tick:
            return x, Control(law_state, sent_rad, fade_rad, known), tick, outcome
        known = take_arrivals(wire, known, s, r, to_ns)
        wanted_rad, before_rad, acting = sent_rad, sent_rad, -1
        if mode == _ACTIVE:
            error_m = r.measured_m[np.uintp(s.tick_sample[now])]
            seen = law_input(wire, known, r, tick, to_ns, error_m, sent_rad)
            law_state, output = law_step(law_params, law_state, seen)
            asked_rad = (c.share if to_ns >= c.share_from_ns else 1.0) * output.steer_rad
            if not math.isfinite(asked_rad):
                return x, Control(law_state, sent_rad, fade_rad, known), tick, LAW_FAILED
            if is_recovery and tick == first_tick:
                fade_rad = sent_rad - asked_rad
            else:
                fade_rad = ramp_step(c.ramp_step_rad, fade_rad)
            if fade_rad == 0.0:
                acting = law_plan(law_params, law_state, seen)
            wanted_rad = asked_rad + fade_rad
            r.law_output[now, 0] = output.steer_rad
            r.law_output[now, 1] = output.disturbance_rad
            r.law_output[now, 2] = output.network_disturbance_rad
            r.law_output[now, 3] = output.compensated_lateral_error_m
        else:
            for column in range(4):
                r.law_output[now, column] = r.law_output[tick - 1, column]
            if mode == _SAFE_STOP:
                wanted_rad = ramp_step(c.ramp_step_rad, wanted_rad)
        sent_rad = limit_step(c.limits, sent_rad, wanted_rad)
        r.sent_rad[now] = sent_rad
        write_plan(wire, c.limits, acting, tick, before_rad)
        known = take_command(wire, known, tick, sent_rad, acting >= 0)
    return x, Control(law_state, sent_rad, fade_rad, known), last_tick, COMPLETE
