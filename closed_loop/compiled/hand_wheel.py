"""The hand wheel in a compiled run: wheel, driver and feedback law, and who steers.

A run without one has ``wheel`` None, which costs nothing. Its steps are those of the nodes.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ...controller.settings import ControllerSettings
from ...controller.who_steers import (
    Steering,
    SteeringRule,
    assist_n_m,
    steering_rule,
    steering_step,
)
from ...dbc.messages import (
    HandWheelFeedback,
    HandWheelState,
    SteeredBy,
    SteeringForce,
    SteeringStatusCode,
    resolutions,
)
from ...hand_wheel.cycle import (
    CYCLE_AT_REST,
    CycleInput,
    CycleParams,
    CycleState,
    cycle_step,
    own_motion,
)
from ...hand_wheel.driver import Sight
from ...hand_wheel.feedback_laws import FEEDBACK_LAWS
from ...hand_wheel.shaking import Shaking, shaking
from ...hand_wheel.wheel_step import AT_REST, WheelParams, WheelState, wheel_step
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.steering.control_unit import status_of
from ...plant_emulator.steering.hand_wheel import Heard, driver_steers, heard_step
from ...plant_emulator.vehicle.motion_choice import MOTIONS
from ...plant_emulator.vehicle.motion_parameters import vehicle_params
from ...plant_emulator.vehicle.single_track_model import VehicleParams
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.node import NEVER_NS, NS_PER_S
from ...runtime.settings import SettingsError
from .hand_wheel_events import Event, WheelEvents
from .inlined_functions import INLINE
from .law_input import (
    Uplink,
    curvature_on_wire_1_m,
    heading_on_wire_rad,
    on_wire,
    quantised,
    speed_on_wire_m_s,
    wheel_on_wire_rad,
    wire,
)
from .loop_records import CURVATURE, HEADING, MEASURED, SPEED, WHEEL
from .refusals import NotCompiledError
from .step_functions import chosen_by_type, register

if TYPE_CHECKING:
    from ...hand_wheel.settings import HandWheelSettings

_LATE_ANSWER, _LATE_STATE, _FORCE, _ANSWER, _CYCLE, _STATE = map(int, Event)
NO_TURN, STEERS, READS, ELSE = range(4)
_LAW, _DRIVER = int(SteeredBy.LAW), int(SteeredBy.DRIVER)
_LATERAL_ERROR, _STEERING_STATUS, _VEHICLE_STATE, _, _STEERING_FORCE = map(int, Uplink)
_APPLYING = int(SteeringStatusCode.APPLYING)
_NEVER_NS = NEVER_NS
_ANGLE_RAD = wire(HandWheelState, "hand_wheel_angle_rad")
_RATE_RAD_S = wire(HandWheelState, "hand_wheel_rate_rad_s")
_TORQUE_N_M = wire(HandWheelState, "driver_torque_n_m")
_FORCE_N = wire(SteeringForce, "rack_force_n")
_ORDER_N_M = resolutions(HandWheelFeedback)["feedback_torque_n_m"]
_RATIO = resolutions(HandWheelFeedback)["steering_ratio"]


register(cycle_step, wheel_step, steering_step, assist_n_m, own_motion)
register(heard_step, driver_steers)
for _motion in MOTIONS.values():
    register(_motion.rack_force_n, _motion.is_limited)


class Wheel(NamedTuple):
    """A hand wheel: its constants, its events, and what the run writes.

    ``ratio``        as HAND_WHEEL_FEEDBACK carries it; ``first_ratio``: before that
    ``force_n``      of each reading, as on the wire
    ``by_sight_rad`` the driver's wish at each cycle, after the one that he starts with
    ``samples``      angle, rate, torques of driver and motor at each cycle, NaN before it; the
                     fifth row is the wheel's own motion, the sixth the path's curvature
    ``steered_by``, ``order_n_m``  of each tick, as HAND_WHEEL_FEEDBACK carries them
    """

    events: WheelEvents
    params: WheelParams
    cycle: CycleParams
    rule: SteeringRule
    vehicle: VehicleParams
    steps: int
    cycle_ns: int
    let_go_ns: int
    ratio: float
    first_ratio: float
    preview_m: float
    speed_m_s: float
    trail_m: float
    arm_m: float
    force_n: FloatArray
    by_sight_rad: FloatArray
    samples: FloatArray
    steered_by: IntArray
    order_n_m: FloatArray

    @property
    def cycles_done(self) -> int:
        """How many cycles the run has reached."""
        return int(np.count_nonzero(np.isfinite(self.samples[0])))

    @property
    def heard_n(self) -> FloatArray:
        """Force on the rack at each cycle as it was last heard; NaN for a law that reads none."""
        newest = self.events.in_use[_STEERING_FORCE, : self.cycles_done]
        reads = [*FEEDBACK_LAWS.values()][self.cycle.law].reads
        return np.append(self.force_n, 0.0)[newest] if reads else np.full(len(newest), np.nan)


class WheelProgress(NamedTuple):
    """State of hand wheel, of who steers, and of what the plant has heard of that.

    ``event``        the next one
    ``rested``       entry of ``by_sight_rad`` since which the driver has not rested
    """

    event: int
    wheel: WheelState
    cycle: CycleState
    rested: int
    plant: Heard
    who: Steering


@lru_cache(maxsize=256)
def _designed(settings: "HandWheelSettings") -> tuple[WheelParams, CycleParams]:
    return settings.wheel_params, settings.cycle_params


def refuse_hand_wheel(
    plant: PlantSettings, controller: ControllerSettings, hand_wheel: "HandWheelSettings | None"
) -> None:
    """Raise NotCompiledError for what a run without this hand wheel does not have."""
    for key, table in (
        ("plant.hand_wheel", plant.hand_wheel),
        ("plant.steering_force", plant.steering_force),
        ("controller.hand_wheel", controller.hand_wheel),
    ):
        if hand_wheel is None and table is not None:
            raise NotCompiledError(
                f"{key}: this compiled run has no hand wheel; leave it out, give one"
                " (simulate(hand_wheel=)), or run the nodes: steer-by-wire run --hand-wheel still"
            )
    for way, line in (("downlink", plant.latency.downlink), ("uplink", plant.latency.uplink)):
        if hand_wheel is not None and line.has_trace:
            raise NotCompiledError(
                f"plant.latency.{way}: compiled runs have no trace of latencies with a hand wheel;"
                " leave it out, or run the nodes: steer-by-wire run --hand-wheel"
            )


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
    model, cycles = settings.nominal_model, len(events.mode)
    return Wheel(
        events,
        *_designed(settings),
        steering_rule(driver, controller.period_s),
        vehicle_params(plant.vehicle),
        steps=settings.steps,
        cycle_ns=settings.cycle_ns,
        let_go_ns=settings.let_go_ns,
        ratio=float(quantised(driver.steering_ratio, _RATIO)),
        first_ratio=link.steering_ratio,
        preview_m=model.preview_distance_m,
        speed_m_s=model.speed_m_s,
        trail_m=force.trail_m,
        arm_m=force.arm_m,
        force_n=np.zeros(int(np.count_nonzero(events.kind == Event.FORCE))),
        by_sight_rad=np.zeros(cycles + 1),
        samples=np.full((6, cycles), np.nan),
        steered_by=np.zeros(len(events.tick_cycle), np.int64),
        order_n_m=np.zeros(len(events.tick_cycle)),
    )


def shaking_of(w: Wheel) -> Shaking | None:
    """Return how the wheel shakes at the end of a run, as the node's report says it."""
    motion_rad, curvatures_1_m = w.samples[4:, : w.cycles_done].tolist()
    return shaking(motion_rad, w.cycle_ns / NS_PER_S, curvatures_1_m=curvatures_1_m)


def _start(w: Wheel) -> WheelProgress:
    heard, who = Heard(0, w.first_ratio), Steering(_LAW, 0, 0.0, False)
    return WheelProgress(0, AT_REST, CYCLE_AT_REST, 0, heard, who)


start_wheel = chosen_by_type({Wheel: _start, None: lambda _: None}.get)
"""(wheel): returns its state at the start."""


@register_jitable(**INLINE)
def next_ns(w: Wheel, x: WheelProgress, ticks_done: int, to_ns: int) -> int:
    """Return when its next event is; for none up to ``to_ns``, later."""
    e, at = w.events, x.event
    if at < len(e.ns) and e.ns[at] <= to_ns and e.ticks[at] <= ticks_done:
        return int(e.ns[at])
    return to_ns + 1


@register_jitable(**INLINE)
def turn_of(w: Wheel, x: WheelProgress, ns: int, command: int, times: tuple[int, int]) -> int:
    """Return what the event at ``ns`` is, unless the next command or all else comes before it.

    One of NO_TURN, STEERS for an angle that acts, READS for the force on the rack, and ELSE.
    """
    command_ns, other_ns = times
    e, at = w.events, x.event
    kind = e.kind[at]
    comes = ns < command_ns and ns < other_ns
    if kind <= _LATE_STATE:
        is_before = ns == command_ns and command >= e.commands[at]
        comes = ns <= other_ns and (ns < command_ns or is_before)
    if not comes:
        return NO_TURN
    if kind == _FORCE:
        return READS
    is_state = kind in (_STATE, _LATE_STATE)
    return STEERS if is_state and driver_steers(x.plant, ns) else ELSE


@register_jitable(**INLINE)
def wanted_rad(w: Wheel, x: WheelProgress) -> float:
    """Return the angle that acts, as one of the road wheels."""
    return float(_angle_on_wire_rad(w, w.events.number[x.event]) / x.plant.ratio)


@register_jitable(**INLINE)
def _angle_on_wire_rad(w: Wheel, cycle: int) -> float:
    return on_wire(w.samples[0, cycle], _ANGLE_RAD)


@register_jitable(**INLINE)
def is_drivers(x: WheelProgress, p: Any, z: Any, guard: Any, now_ns: int) -> bool:
    """Whether STEERING_STATUS says DRIVER_STEERS."""
    return driver_steers(x.plant, now_ns) and status_of(guard, _is_limited(p, z)) == _APPLYING


@register_jitable(**INLINE)
def read_force(w: Wheel, x: WheelProgress, p: Any, z: Any) -> None:
    """Keep the force on the rack, as STEERING_FORCE carries it."""
    force_n = _rack_force_n(p, z, w.vehicle, w.trail_m, w.arm_m)
    w.force_n[w.events.number[x.event]] = on_wire(force_n, _FORCE_N)


@register_jitable(**INLINE)
def after_event(w: Wheel, r: Any, x: WheelProgress, now_ns: int) -> WheelProgress:
    """Return the state after an event, which is then the next one's."""
    e, at = w.events, x.event
    kind, number, heard = e.kind[at], e.number[at], x.plant
    if kind == _CYCLE:
        return _run_cycle(w, r, x, number)
    if kind in (_ANSWER, _LATE_ANSWER):
        heard = heard_step(heard, w.steered_by[number], w.ratio, now_ns)
    return WheelProgress(at + 1, x.wheel, x.cycle, x.rested, heard, x.who)


@register_jitable(**INLINE)
def _run_cycle(w: Wheel, r: Any, x: WheelProgress, cycle: int) -> WheelProgress:
    """Run a cycle of the hand wheel, as ``HandWheelNode.on_tick``."""
    e, wheel = w.events, x.wheel
    if cycle > 0:
        for _ in range(w.steps):
            wheel = wheel_step(w.params, wheel, x.cycle.told_n_m, x.cycle.hands)
    tick = e.cycle_tick[cycle]
    error_m = heading_rad = curvature_1_m = road_wheel_rad = force_n = 0.0
    speed_m_s, sample = w.speed_m_s, e.in_use[_LATERAL_ERROR, cycle]
    if sample >= 0:
        error_m = r.samples[MEASURED, sample]
        heading_rad = heading_on_wire_rad(r.samples[HEADING, sample], e.heading_noise_rad[sample])
    sample = e.in_use[_VEHICLE_STATE, cycle]
    if sample >= 0:
        curvature_1_m = curvature_on_wire_1_m(r.samples[CURVATURE, sample])
        speed_m_s = speed_on_wire_m_s(r.samples[SPEED, sample])
    sample = e.in_use[_STEERING_STATUS, cycle]
    if sample >= 0:
        road_wheel_rad = wheel_on_wire_rad(r.samples[WHEEL, sample])
    sample = e.in_use[_STEERING_FORCE, cycle]
    if sample >= 0:
        force_n = w.force_n[sample]
    reaction = max(w.cycle.driver.two_point.reaction, 1)
    known = CycleInput(
        w.by_sight_rad[max(cycle + 1 - reaction, x.rested)],
        Sight(error_m, heading_rad, curvature_1_m, speed_m_s, w.preview_m),
        e.kick_n_m[cycle],
        cycle * w.cycle_ns < w.let_go_ns,
        w.steered_by[tick] != _LAW,
        wheel,
        force_n,
        road_wheel_rad,
        w.ratio,
        w.order_n_m[tick],
        e.mode[cycle],
        e.share[cycle],
    )
    state = cycle_step(w.cycle, x.cycle, known)
    w.by_sight_rad[cycle + 1] = state.driver.by_sight_rad
    w.samples[0, cycle], w.samples[1, cycle] = wheel.angle_rad, wheel.rate_rad_s
    w.samples[2, cycle], w.samples[3, cycle] = wheel.driver_torque_n_m, wheel.motor_n_m
    alone, followed_rad = w.steered_by[tick] == _DRIVER, w.ratio * road_wheel_rad
    w.samples[4, cycle], w.samples[5, cycle] = own_motion(
        wheel.angle_rad, state.hands, alone, followed_rad, curvature_1_m
    )
    rested = cycle + 1 if state.driver.rests else x.rested
    return WheelProgress(x.event + 1, wheel, state, rested, x.plant, x.who)


@register_jitable(**INLINE)
def decide(
    w: Wheel, r: Any, x: WheelProgress, tick: int, now_ns: int, law: tuple[float, float, bool]
) -> tuple[WheelProgress, float, bool]:
    """Decide who steers, as the controller; returns the command and whether the law takes over.

    ``law``  its command, the command before, and whether it can steer
    """
    wanted_rad, sent_rad, can_steer = law
    cycle = w.events.tick_cycle[tick]
    torque_n_m, angle_rad, rate_rad_s, age_ns = 0.0, 0.0, 0.0, _NEVER_NS
    if cycle >= 0:
        angle_rad = _angle_on_wire_rad(w, cycle)
        rate_rad_s = on_wire(w.samples[1, cycle], _RATE_RAD_S)
        torque_n_m = on_wire(w.samples[2, cycle], _TORQUE_N_M)
        age_ns = now_ns - cycle * w.cycle_ns
    steering = steering_step(w.rule, x.who, torque_n_m, age_ns, now_ns, can_steer)
    order_n_m = assist_n_m(w.rule, steering, wanted_rad, angle_rad, rate_rad_s)
    w.steered_by[tick], w.order_n_m[tick] = steering.steered_by, quantised(order_n_m, _ORDER_N_M)
    if steering.steered_by != _LAW:
        sample = w.events.tick_wheel[tick]
        wanted_rad = wheel_on_wire_rad(r.samples[WHEEL, sample]) if sample >= 0 else 0.0
    elif steering.takes_over:
        wanted_rad = sent_rad
    after = WheelProgress(x.event, x.wheel, x.cycle, x.rested, x.plant, steering)
    return after, wanted_rad, steering.takes_over


def _limited(is_limited: Callable[[Any], Any]) -> Callable[[Any, Any], Any]:
    return lambda _params, z: is_limited(z)


_is_limited = chosen_by_type(lambda kind: _limited(MOTIONS[kind].is_limited))
_rack_force_n = chosen_by_type(lambda kind: MOTIONS[kind].rack_force_n)
