"""The hand wheel in a compiled run: wheel, driver and feedback law, and who steers.

A run without one has ``wheel`` None, which costs nothing. Its steps are those of the nodes.
"""

import math
from collections.abc import Callable
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from ...controller.settings import ControllerSettings
from ...controller.who_steers import (
    AssistRule,
    Steering,
    SteeringRule,
    assist_rule,
    assist_step,
    steering_rule,
    steering_step,
)
from ...dbc.messages import (
    HandWheelFeedback,
    HandWheelState,
    Mode,
    SteeredBy,
    SteeringForce,
    SteeringStatusCode,
    limits,
    resolutions,
)
from ...hand_wheel.driver import (
    DRIVER_AT_REST,
    HANDS_OFF,
    DriverParams,
    DriverState,
    Sight,
    driver_step,
)
from ...hand_wheel.feedback_laws import (
    FEEDBACK_AT_REST,
    FEEDBACK_LAWS,
    FeedbackInput,
    FeedbackParams,
    FeedbackState,
    cdob_step,
    model_step,
    rack_force_step,
    resist,
    spring_step,
)
from ...hand_wheel.wheel_step import AT_REST, Hands, WheelParams, WheelState, wheel_step
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.steering.control_unit import status_of
from ...plant_emulator.steering.hand_wheel import SILENCE_NS
from ...plant_emulator.vehicle.car.car_motion import CarMotionParams
from ...plant_emulator.vehicle.car.rack import RackParams
from ...plant_emulator.vehicle.motion_choice import MOTIONS
from ...plant_emulator.vehicle.motion_parameters import vehicle_params
from ...plant_emulator.vehicle.single_track_model import VehicleParams
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.node import NEVER_NS
from ...runtime.settings import SettingsError
from .hand_wheel_events import Event, WheelEvents
from .inlined_functions import INLINE
from .law_input import (
    curvature_on_wire_1_m,
    heading_on_wire_rad,
    quantised,
    speed_on_wire_m_s,
    wheel_on_wire_rad,
)
from .loop_records import CURVATURE, HEADING, MEASURED, SPEED, WHEEL
from .step_functions import register

if TYPE_CHECKING:
    from ...hand_wheel.settings import HandWheelSettings

_ARRIVAL, _FORCE, _ANSWER, _CYCLE, _STATE = map(int, Event)
_LAW, _BOTH = int(SteeredBy.LAW), int(SteeredBy.BOTH)
_ACTIVE, _HOLDING = int(Mode.ACTIVE), int(Mode.HOLDING)
_APPLYING = int(SteeringStatusCode.APPLYING)
_LAWS = tuple(FEEDBACK_LAWS)
_RACK_FORCE, _SPRING, _MODEL = (_LAWS.index(name) for name in ("rack_force", "spring", "model"))
_SILENCE_NS, _NEVER_NS = SILENCE_NS, NEVER_NS
_ANGLE_RAD, _RATE_RAD_S, _TORQUE_N_M = (
    resolutions(HandWheelState)[name]
    for name in ("hand_wheel_angle_rad", "hand_wheel_rate_rad_s", "driver_torque_n_m")
)
_ANGLE_RAD_MAX, _RATE_RAD_S_MAX, _TORQUE_N_M_MAX = (
    limits(HandWheelState)[name].maximum
    for name in ("hand_wheel_angle_rad", "hand_wheel_rate_rad_s", "driver_torque_n_m")
)
_FORCE_N = resolutions(SteeringForce)["rack_force_n"]
_FORCE_N_MAX = limits(SteeringForce)["rack_force_n"].maximum
_ORDER_N_M = resolutions(HandWheelFeedback)["feedback_torque_n_m"]
_RATIO = resolutions(HandWheelFeedback)["steering_ratio"]


class Wheel(NamedTuple):
    """A hand wheel: its constants, its events, and what the run writes.

    ``ratio``        as HAND_WHEEL_FEEDBACK carries it; ``first_ratio``: before that
    ``force_n_n``    force on the rack per lateral force of the front axle
    ``force_n``      of each reading, as on the wire
    ``*_wire``       of each cycle, as HAND_WHEEL_STATE carries it
    ``by_sight_rad`` wish of each cycle behind the one before the first
    ``samples``      angle, rate, torques of driver and motor at each cycle, NaN before it
    ``heard_n``      force on the rack as it was last heard, NaN for a law that reads none
    ``steered_by``, ``order_n_m``  of each tick, as HAND_WHEEL_FEEDBACK carries them
    """

    events: WheelEvents
    params: WheelParams
    driver: DriverParams
    feedback: FeedbackParams
    rule: SteeringRule
    assist: AssistRule
    vehicle: VehicleParams
    law: int
    steps: int
    cycle_ns: int
    let_go_ns: int
    ratio: float
    first_ratio: float
    preview_m: float
    speed_m_s: float
    servo_n_m: float
    servo_n_m_s: float
    fallback_damping_n_m_s: float
    trail_m: float
    arm_m: float
    force_n: FloatArray
    angle_wire: FloatArray
    rate_wire: FloatArray
    torque_wire: FloatArray
    by_sight_rad: FloatArray
    samples: FloatArray
    heard_n: FloatArray
    steered_by: IntArray
    order_n_m: FloatArray


class WheelProgress(NamedTuple):
    """State of hand wheel, of who steers, and of what the plant has heard of that.

    ``event``        the next one
    ``rested``       entry of ``by_sight_rad`` since which the driver has not rested
    ``law_until_ns`` until when the plant takes the law for the one who steers
    """

    event: int
    wheel: WheelState
    driver: DriverState
    rested: int
    feedback: FeedbackState
    hands: Hands
    told_n_m: float
    law_n_m: float
    law_until_ns: int
    ratio: float
    steering: Steering
    share: float


@lru_cache(maxsize=256)
def _designed(settings: "HandWheelSettings") -> tuple[WheelParams, DriverParams, FeedbackParams]:
    return settings.wheel_params, settings.driver_params, settings.feedback_params


@cache
def _register_steps() -> None:
    motions = [
        part for each in MOTIONS.values() for part in (each.front_lateral_n, each.is_limited)
    ]
    laws = [law.step for law in FEEDBACK_LAWS.values()]
    around = (driver_step, wheel_step, resist, steering_step, assist_step)
    steps: list[Callable[..., Any]] = [*around, *laws, *motions, _cycle, _law_step, _on_wire]
    for function in steps:
        register(function)


def wheel_of(
    plant: PlantSettings,
    controller: ControllerSettings,
    settings: "HandWheelSettings",
    events: WheelEvents,
) -> Wheel:
    """Return the hand wheel of one run. Raises SettingsError for settings that lack it."""
    force, driver, link = plant.steering_force, controller.hand_wheel, plant.hand_wheel
    if force is None or driver is None or link is None:
        raise SettingsError(
            "hand_wheel: needs plant.steering_force, plant.hand_wheel and controller.hand_wheel"
        )
    _register_steps()
    table, model, cycles = settings.feedback, settings.nominal_model, len(events.mode)
    return Wheel(
        events,
        *_designed(settings),
        steering_rule(driver),
        assist_rule(driver, controller.period_s),
        vehicle_params(plant.vehicle),
        law=_LAWS.index(table.law),
        steps=settings.steps,
        cycle_ns=settings.cycle_ns,
        let_go_ns=settings.let_go_ns,
        ratio=float(quantised(driver.steering_ratio, _RATIO)),
        first_ratio=link.steering_ratio,
        preview_m=model.preview_distance_m,
        speed_m_s=model.speed_m_s,
        servo_n_m=table.servo_n_m,
        servo_n_m_s=table.servo_n_m_s,
        fallback_damping_n_m_s=settings.supervision.fallback_damping_n_m_s,
        trail_m=force.trail_m,
        arm_m=force.arm_m,
        force_n=np.zeros(int(np.count_nonzero(events.kind == Event.FORCE))),
        angle_wire=np.zeros(cycles),
        rate_wire=np.zeros(cycles),
        torque_wire=np.zeros(cycles),
        by_sight_rad=np.zeros(cycles + 1),
        samples=np.full((4, cycles), np.nan),
        heard_n=np.full(cycles, np.nan),
        steered_by=np.zeros(len(events.tick_cycle), np.int64),
        order_n_m=np.zeros(len(events.tick_cycle)),
    )


def _choosing(with_wheel: Any, without: Any) -> Any:
    """Return a function for compiled code: ``with_wheel``, or ``without`` one."""

    def chosen(*_: Any) -> Any:
        raise NotImplementedError("for compiled code")

    def of_type(wheel: Any, *_: Any) -> Any:
        return without if isinstance(wheel, types.NoneType) else with_wheel

    overload(chosen, strict=False, jit_options=INLINE)(of_type)
    return chosen


def _start(w: Wheel) -> WheelProgress:
    hands = Hands(HANDS_OFF, 0.0, 0.0, 0.0)
    drives, steers = (DRIVER_AT_REST, 0, FEEDBACK_AT_REST), Steering(_LAW, 0)
    return WheelProgress(
        0, AT_REST, drives[0], drives[1], drives[2], hands, 0.0, 0.0, 0, w.first_ratio, steers, 0.0
    )


def _next_ns(w: Wheel, x: WheelProgress, ticks_done: int, to_ns: int) -> int:
    e, at = w.events, x.event
    if at < len(e.ns) and e.ns[at] <= to_ns and e.ticks[at] <= ticks_done:
        return int(e.ns[at])
    return to_ns + 1


def _is_turn(w: Wheel, x: WheelProgress, ns: int, command: int, times: tuple[int, int]) -> bool:
    """Whether an event at ``ns`` comes before the next command, and before all else."""
    command_ns, other_ns = times
    e, at = w.events, x.event
    if e.kind[at] != _ARRIVAL:
        return ns < command_ns and ns < other_ns
    return ns <= other_ns and (ns < command_ns or (ns == command_ns and command >= e.commands[at]))


def _is_steering(w: Wheel, x: WheelProgress, now_ns: int) -> bool:
    """Whether the event is an angle of the hand wheel that acts."""
    kind = w.events.kind[x.event]
    is_state = kind == _STATE or (kind == _ARRIVAL and w.events.is_state[x.event] != 0)
    return is_state and now_ns >= x.law_until_ns


def _wanted_rad(w: Wheel, x: WheelProgress) -> float:
    return float(w.angle_wire[w.events.number[x.event]] / x.ratio)


def _event(w: Wheel, r: Any, x: WheelProgress, now_ns: int) -> WheelProgress:
    """Let an event happen that does not move the vehicle; the next one follows."""
    e, at = w.events, x.event
    kind, index = e.kind[at], e.number[at]
    law_until_ns, ratio = x.law_until_ns, x.ratio
    if kind == _CYCLE:
        return _cycle(w, r, x, index)
    if kind == _ANSWER or (kind == _ARRIVAL and e.is_state[at] == 0):
        law_until_ns = now_ns + _SILENCE_NS if w.steered_by[index] == _LAW else 0
        ratio = w.ratio
    return WheelProgress(
        at + 1, x.wheel, x.driver, x.rested, x.feedback, x.hands, x.told_n_m, x.law_n_m,
        law_until_ns, ratio, x.steering, x.share,
    )  # fmt: skip


def _cycle(w: Wheel, r: Any, x: WheelProgress, cycle: int) -> WheelProgress:
    """Run a cycle of the hand wheel, as ``HandWheelNode.on_tick``."""
    e, wheel = w.events, x.wheel
    if cycle > 0:
        for _ in range(w.steps):
            wheel = wheel_step(w.params, wheel, x.told_n_m, x.hands)
    angle_rad, rate_rad_s, motor_n_m, driver_n_m, _, _ = wheel
    steered_by = w.steered_by[e.cycle_tick[cycle]]
    error_m = heading_rad = curvature_1_m = road_wheel_rad = force_n = 0.0
    speed_m_s, sample = w.speed_m_s, e.error_sample[cycle]
    if sample >= 0:
        error_m = r.samples[MEASURED, sample]
        heading_rad = heading_on_wire_rad(r.samples[HEADING, sample], e.heading_noise_rad[sample])
    sample = e.vehicle_sample[cycle]
    if sample >= 0:
        curvature_1_m = curvature_on_wire_1_m(r.samples[CURVATURE, sample])
        speed_m_s = speed_on_wire_m_s(r.samples[SPEED, sample])
    sample = e.status_sample[cycle]
    if sample >= 0:
        road_wheel_rad = wheel_on_wire_rad(r.samples[WHEEL, sample])
    if e.force_sample[cycle] >= 0:
        force_n = w.force_n[e.force_sample[cycle]]
    sight = Sight(error_m, heading_rad, curvature_1_m, speed_m_s, w.preview_m)
    late_rad = w.by_sight_rad[max(cycle + 1 - max(w.driver.two_point.reaction, 1), x.rested)]
    holds, drives = cycle * w.cycle_ns < w.let_go_ns, steered_by != _LAW
    driver, hands = driver_step(
        w.driver, x.driver, late_rad, sight, angle_rad, e.kick_n_m[cycle], holds, drives
    )
    w.by_sight_rad[cycle + 1] = driver.by_sight_rad
    share, mode = e.share[cycle], e.mode[cycle]
    feedback, law_n_m = x.feedback, x.law_n_m
    if mode in (_ACTIVE, _HOLDING) or share > 0.0:
        observed = FeedbackInput(angle_rad, rate_rad_s, force_n, road_wheel_rad)
        feedback, against_n_m = _law_step(w, feedback, observed)
        feedback, law_n_m = resist(w.feedback, feedback, against_n_m, rate_rad_s)
    felt_n_m = law_n_m
    if not drives:
        lack_rad = w.ratio * road_wheel_rad - angle_rad
        felt_n_m = w.servo_n_m * lack_rad - w.servo_n_m_s * rate_rad_s
    local_n_m = -w.fallback_damping_n_m_s * rate_rad_s
    order_n_m = w.order_n_m[e.cycle_tick[cycle]]
    told_n_m = share * felt_n_m + order_n_m + (1.0 - share) * local_n_m
    if not math.isfinite(told_n_m):
        told_n_m = local_n_m
    w.angle_wire[cycle] = _on_wire(angle_rad, _ANGLE_RAD_MAX, _ANGLE_RAD)
    w.rate_wire[cycle] = _on_wire(rate_rad_s, _RATE_RAD_S_MAX, _RATE_RAD_S)
    w.torque_wire[cycle] = _on_wire(driver_n_m, _TORQUE_N_M_MAX, _TORQUE_N_M)
    if w.law != _MODEL:
        w.heard_n[cycle] = force_n
    w.samples[0, cycle], w.samples[1, cycle] = angle_rad, rate_rad_s
    w.samples[2, cycle], w.samples[3, cycle] = driver_n_m, motor_n_m
    return WheelProgress(
        x.event + 1, wheel, driver, cycle + 1 if driver.rests else x.rested, feedback, hands,
        told_n_m, law_n_m, x.law_until_ns, x.ratio, x.steering, x.share,
    )  # fmt: skip


def _law_step(w: Wheel, x: FeedbackState, u: FeedbackInput) -> tuple[FeedbackState, float]:
    if w.law == _RACK_FORCE:
        return rack_force_step(w.feedback, x, u)
    if w.law == _SPRING:
        return spring_step(w.feedback, x, u)
    if w.law == _MODEL:
        return model_step(w.feedback, x, u)
    return cdob_step(w.feedback, x, u)


def _on_wire(value: float, most: float, resolution: float) -> float:
    return quantised(min(max(value, -most), most), resolution)


def _decide(
    w: Wheel, r: Any, x: WheelProgress, tick: int, now_ns: int, law: tuple[float, float, bool]
) -> tuple[WheelProgress, float, bool]:
    """Decide who steers, as the controller; returns the command and whether the law takes over.

    ``law``  its command, the command before, and whether it can steer
    """
    wanted_rad, sent_rad, can_steer = law
    e, cycle = w.events, w.events.tick_cycle[tick]
    torque_n_m = angle_rad = rate_rad_s = 0.0
    age_ns = _NEVER_NS
    if cycle >= 0:
        torque_n_m, angle_rad, rate_rad_s = (
            w.torque_wire[cycle], w.angle_wire[cycle], w.rate_wire[cycle],
        )  # fmt: skip
        age_ns = now_ns - cycle * w.cycle_ns
    before = x.steering.steered_by
    steering = steering_step(w.rule, x.steering, torque_n_m, age_ns, now_ns, can_steer)
    both = steering.steered_by == _BOTH
    share, order_n_m = assist_step(w.assist, x.share, both, wanted_rad, angle_rad, rate_rad_s)
    w.steered_by[tick], w.order_n_m[tick] = steering.steered_by, quantised(order_n_m, _ORDER_N_M)
    takes_over = before != _LAW and steering.steered_by == _LAW and can_steer
    if steering.steered_by != _LAW:
        sample = e.tick_wheel[tick]
        wanted_rad = wheel_on_wire_rad(r.samples[WHEEL, sample]) if sample >= 0 else 0.0
    elif takes_over:
        wanted_rad = sent_rad
    after = WheelProgress(
        x.event, x.wheel, x.driver, x.rested, x.feedback, x.hands, x.told_n_m, x.law_n_m,
        x.law_until_ns, x.ratio, steering, share,
    )  # fmt: skip
    return after, wanted_rad, takes_over


def rack_force_n(*_: Any) -> Any:
    """Return the force on the rack, for compiled code."""
    raise NotImplementedError("for compiled code")


@overload(rack_force_n, strict=False, jit_options=INLINE)
def _rack_force_of(params: Any, z: Any, vehicle: Any, trail_m: Any, arm_m: Any) -> Any:  # noqa: ARG001
    kind = params.instance_class
    front_n = MOTIONS[kind].front_lateral_n
    steering = dict(zip(params.fields, params.types, strict=True)).get("steering")
    if kind is CarMotionParams and getattr(steering, "instance_class", None) is RackParams:

        def of_rack(params: Any, z: Any, vehicle: Any, trail_m: Any, arm_m: Any) -> Any:  # noqa: ARG001
            _, _, moved = z
            return moved[2].steering.rack_force_n

        return of_rack

    def of_axle(params: Any, z: Any, vehicle: Any, trail_m: Any, arm_m: Any) -> Any:
        return -front_n(params, z, vehicle) * trail_m / arm_m

    return of_axle


def is_limited(*_: Any) -> Any:
    """Return whether a limit of the actuator shapes the motion, for compiled code."""
    raise NotImplementedError("for compiled code")


@overload(is_limited, strict=False, jit_options=INLINE)
def _is_limited_of(params: Any, z: Any) -> Any:  # noqa: ARG001
    limited = MOTIONS[params.instance_class].is_limited
    return lambda params, z: limited(z)  # noqa: ARG005


def _read_force(w: Wheel, x: WheelProgress, p: Any, z: Any) -> None:
    force_n = rack_force_n(p, z, w.vehicle, w.trail_m, w.arm_m)
    w.force_n[w.events.number[x.event]] = _on_wire(force_n, _FORCE_N_MAX, _FORCE_N)


def _reads_force(w: Wheel, x: WheelProgress) -> bool:
    return bool(w.events.kind[x.event] == _FORCE)


def _driver_steers(_w: Wheel, x: WheelProgress, now_ns: int) -> bool:
    return now_ns >= x.law_until_ns


def _is_drivers(_w: Wheel, x: WheelProgress, p: Any, z: Any, guard: Any, now_ns: int) -> bool:
    """Whether STEERING_STATUS says that the driver steers."""
    return now_ns >= x.law_until_ns and status_of(guard, is_limited(p, z)) == _APPLYING


start_wheel = _choosing(_start, lambda _w: None)
"""(wheel): returns its state at the start."""
next_ns = _choosing(_next_ns, lambda _w, _x, _ticks, to_ns: to_ns + 1)
"""(wheel, state, ticks_done, to_ns): when its next event is; for none up to ``to_ns``, later."""
is_turn = _choosing(_is_turn, lambda *_: False)
"""(wheel, state, ns, command, times): whether that event comes before all else."""
is_steering = _choosing(_is_steering, lambda *_: False)
"""(wheel, state, now_ns): whether it is an angle that acts."""
wanted_rad = _choosing(_wanted_rad, lambda *_: 0.0)
"""(wheel, state): that angle, as one of the road wheels."""
reads_force = _choosing(_reads_force, lambda *_: False)
"""(wheel, state): whether it is a reading of the force on the rack."""
read_force = _choosing(_read_force, lambda *_: None)
"""(wheel, state, params, motion): keeps that force."""
after_event = _choosing(_event, lambda _w, _r, x, _now: x)
"""(wheel, records, state, now_ns): returns the state after an event."""
driver_steers = _choosing(_driver_steers, lambda *_: False)
"""(wheel, state, now_ns): whether the plant takes commands for an echo alone."""
is_drivers = _choosing(_is_drivers, lambda *_: False)
"""(wheel, state, params, motion, guard, now_ns): whether STEERING_STATUS says DRIVER_STEERS."""
decide = _choosing(_decide, lambda _w, _r, x, _tick, _now, law: (x, law[0], False))
"""(wheel, records, state, tick, now_ns, law): who steers; its state, the command, take-over."""
