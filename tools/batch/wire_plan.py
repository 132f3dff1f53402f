"""What a law that looks back is told at each tick, laid down before the run.

As ``controller.link_memory`` finds it frame by frame: which sample of each message is the newest,
which command each echo names, and the delay that follows. All of it depends on the network alone.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.design import link_of
from controller.freshness import AgeLimits
from controller.link import NO_DELAY, DelayState, LinkParams, delay_of, delay_step
from controller.link_memory import E2E_COUNTERS, RING_SIZE
from controller.settings import ControllerSettings, age_limits_of
from dbc.messages import LateralError, SteeringStatus, VehicleState, limits, resolutions
from plant_emulator.safety_settings import design_guard
from plant_emulator.settings import PlantSettings
from plant_emulator.steering_guard import OFF_NS, GuardMode
from plant_emulator.steering_unit import answers_to
from plant_emulator.streams import Channel, first_uniforms
from tools.batch.compilation import compiled
from tools.batch.network import FloatArray, IntArray, normal_scores
from tools.batch.plan import Arrivals, Believing, Plan, Uplink, arrivals_of, believing_of
from tools.batch.sensor_rate import wrong_at
from tools.batch.wire import Wire, on_wire

_KEPT = 8
"""Wires kept for the next run on the same network: a megabyte each."""


class UnclearSampleError(ValueError):
    """Samples come so late, or so far apart, that their counters do not tell their numbers."""


class LostWheelError(ValueError):
    """The wheel did not follow, which a run of a law that looks back has not been laid down for."""


class _Link(NamedTuple):
    """The first eight fields of ``Wire``, and the noise; the arrays that runs share."""

    error_sample: IntArray
    echo_sample: IntArray
    vehicle_sample: IntArray
    is_vehicle_stale: IntArray
    delay_ns: FloatArray
    is_measured: IntArray
    has_error: IntArray
    has_echo: IntArray
    applied_tick: IntArray
    heading_noise_rad: FloatArray
    yaw_rate_noise_rad_s: FloatArray


class _Steering(NamedTuple):
    """Of the commands that come through, the indices of those that set the wheel's target, and
    whether commands decide about it from each of them on.
    """

    followed: IntArray
    is_in_control: NDArray[np.bool_]


class _Ticks(NamedTuple):
    """Ticks of a plan and the commands that come through, hashed by identity of the plan."""

    plan: Plan

    def __hash__(self) -> int:
        return id(self.plan)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Ticks) and other.plan is self.plan


def plan_wire(
    plant: PlantSettings, controller: ControllerSettings, plan: Plan, speed_m_s: float
) -> Wire:
    """Lay down the wire of one run. Raises UnclearSampleError."""
    link = _link(
        plant_network(plant),
        believing_of(controller),
        link_of(controller),
        age_limits_of(controller),
        _Ticks(plan),
    )
    error, state = resolutions(LateralError), resolutions(VehicleState)
    ranges = limits(VehicleState)
    samples = len(plan.sample_ns)
    return Wire(
        *link,
        measured_heading_rad=np.empty(samples),
        measured_yaw_rate_rad_s=np.empty(samples),
        measured_curvature_1_m=np.empty(samples),
        speed_m_s=speed_on_wire(speed_m_s),
        heading_resolution_rad=error["heading_error_rad"],
        yaw_rate_resolution_rad_s=state["yaw_rate_rad_s"],
        yaw_rate_rad_s_max=ranges["yaw_rate_rad_s"].maximum,
        curvature_resolution_1_m=state["preview_curvature_1_m"],
        curvature_1_m_max=ranges["preview_curvature_1_m"].maximum,
        is_overruled=np.empty(samples, dtype=np.int64),
        wheel_rad=np.empty(samples),
        wheel_resolution_rad=resolutions(SteeringStatus)["wheel_angle_rad"],
        wheel_rad_max=limits(SteeringStatus)["wheel_angle_rad"].maximum,
    )


def speed_on_wire(speed_m_s: float) -> float:
    """Return the speed as VEHICLE_STATE carries it [m/s]."""
    highest_m_s = limits(VehicleState)["speed_m_s"].maximum
    return float(on_wire(min(speed_m_s, highest_m_s), resolutions(VehicleState)["speed_m_s"]))


def plant_network(plant: PlantSettings) -> PlantSettings:
    """Return the settings with everything left as it is by default but the network, and what the
    steering makes of commands that it keeps away.
    """
    return PlantSettings(
        seed=plant.seed,
        duration_s=plant.duration_s,
        sensor_period_ms=plant.sensor_period_ms,
        start_on_first_command=plant.start_on_first_command,
        sensor_noise=plant.sensor_noise,
        latency=plant.latency,
        safety=plant.safety,
    )


@lru_cache(maxsize=_KEPT)
def _link(
    plant: PlantSettings,
    believing: Believing,
    params: LinkParams,
    limits_ns: AgeLimits,
    ticks: _Ticks,
) -> _Link:
    plan = ticks.plan
    samples = len(plan.sample_ns)
    errors, echoes, states = (
        arrivals_of(message, plant, believing, samples, plan.motion_start_ns) for message in Uplink
    )
    _refuse_unclear(errors, echoes, params)
    errors, echoes = _rising(errors), _rising(echoes)
    steering = _steering(plant, plan)
    echoed = _echoed_ticks(plan, steering.followed, echoes)
    is_ignoring = _is_ignoring(plant, plan, steering, echoes)
    delay_ns = _delays(params, limits_ns.steering_status_ns, echoes, echoed, is_ignoring)
    newest_echo = _newest(echoes, plan.tick_ns)
    newest_state = _newest(states, plan.tick_ns)
    knows_speed = newest_state >= 0
    knows_echo = knows_speed & (newest_echo >= 0)
    has_error = np.zeros(samples, dtype=np.int64)
    has_error[errors.sample] = 1
    has_echo = np.zeros(samples, dtype=np.int64)
    has_echo[echoes.sample] = 1
    state_age_ns = plan.tick_ns - _at(states.arrival_ns, newest_state)
    is_vehicle_stale = knows_speed & (state_age_ns > limits_ns.vehicle_state_ns)
    echo_age_ns = plan.tick_ns - _at(echoes.arrival_ns, newest_echo)
    is_measured = knows_echo & (echo_age_ns <= limits_ns.steering_status_ns) & ~is_vehicle_stale
    newest_error = _newest(errors, plan.tick_ns)
    is_measured &= ~wrong_at(params.sensor_period_ns, errors, newest_error)
    heading_noise_rad, yaw_rate_noise_rad_s = _noise(plant, samples)
    return _Link(
        error_sample=np.where(knows_speed, _at(errors.sample, newest_error), -1),
        echo_sample=np.where(knows_echo, _at(echoes.sample, newest_echo), -1),
        vehicle_sample=_at(states.sample, newest_state),
        is_vehicle_stale=is_vehicle_stale.astype(np.int64),
        delay_ns=np.where(knows_echo, _at(delay_ns, newest_echo, 0.0), 0.0),
        is_measured=is_measured.astype(np.int64),
        has_error=has_error,
        has_echo=has_echo,
        applied_tick=_held(echoes.sample, echoed, samples),
        heading_noise_rad=heading_noise_rad,
        yaw_rate_noise_rad_s=yaw_rate_noise_rad_s,
    )


def _refuse_unclear(errors: Arrivals, echoes: Arrivals, params: LinkParams) -> None:
    """Raise UnclearSampleError where a counter would be taken for that of another sample."""
    first = min(
        (arrivals.arrival_ns[0], arrivals.sample[0])
        for arrivals in (errors, echoes)
        if len(arrivals.sample)
    )
    numbers = [int(first[1])]
    for arrivals in (errors, echoes):
        if len(arrivals.sample):
            waited = (arrivals.arrival_ns[0] - first[0]) // params.sensor_period_ns
            numbers.append(abs(int(arrivals.sample[0] - first[1] - waited)) + E2E_COUNTERS // 2)
            expected = np.diff(arrivals.arrival_ns) // params.sensor_period_ns
            off = np.abs(np.diff(arrivals.sample) - expected)
            numbers.append(int(off.max(initial=0)) + E2E_COUNTERS // 2)
    if max(numbers) >= E2E_COUNTERS:
        raise UnclearSampleError(
            "latencies differ, or measurements stay away, by more than 127 sensor periods:"
            " compiled runs do not follow a law that looks back through that"
        )


def _rising(arrivals: Arrivals) -> Arrivals:
    """Return those that are of a later sample than all before."""
    newest = np.maximum.accumulate(arrivals.sample)
    is_new = np.diff(newest, prepend=-1) > 0
    return Arrivals(arrivals.arrival_ns[is_new], arrivals.sample[is_new])


def _newest(arrivals: Arrivals, tick_ns: IntArray) -> IntArray:
    """Return which has arrived last at each tick, -1 for none."""
    return np.searchsorted(arrivals.arrival_ns, tick_ns, side="right") - 1


def _at(values: Any, index: IntArray, none: float = -1) -> Any:
    """Return the values at indices, ``none`` at -1."""
    return np.append(values, np.array(none, dtype=values.dtype))[index]


def _steering(plant: PlantSettings, plan: Plan) -> _Steering:
    """Return what the steering makes of the commands that come through."""
    guard = design_guard(plant.safety, plant.vehicle, plant.actuator)
    motion_ns = plan.command_due_ns - plan.motion_start_ns
    is_quiet = len(motion_ns) > 0 and np.diff(motion_ns).max(initial=0) >= guard.silence_ns
    if not is_quiet and guard.override_ns == OFF_NS:
        every = np.arange(len(motion_ns))
        return _Steering(every, np.ones(len(every), dtype=np.bool_))
    is_sent_then = plan.tick_ns[plan.command_tick] == plan.command_due_ns
    commands = zip(motion_ns.tolist(), is_sent_then.tolist(), strict=True)
    is_followed, mode = np.array(answers_to(guard, commands), dtype=np.int64).reshape(-1, 2).T
    return _Steering(np.flatnonzero(is_followed), mode == GuardMode.FOLLOWING)


def refuse_lost_wheel(plant: PlantSettings, plan: Plan, command: IntArray) -> None:
    """Raise LostWheelError if a run, whose commands in effect are given, followed other commands.

    That is so after the steering has gone to its safe state because the wheel did not follow: what
    the echoes told from then on was laid down otherwise.
    """
    if not len(command):
        return
    last_ns = plan.sample_ns[len(command) - 1]
    chosen = _steering(plant, plan).followed
    due_ns, sent_ns = plan.command_due_ns[chosen], plan.tick_ns[plan.command_tick[chosen]]
    in_effect = chosen[(due_ns <= last_ns) & (sent_ns < last_ns)]
    if len(in_effect) and command[-1] != in_effect[-1]:
        raise LostWheelError(
            "the wheel did not follow and the steering went to its safe state: compiled runs do not"
            " follow a law that looks back through that; safety.follow_tolerance_rad or"
            " .follow_time_ms decide on it"
        )


def _echoed_ticks(plan: Plan, followed_commands: IntArray, echoes: Arrivals) -> IntArray:
    """Return the tick whose command each echo names, -1 for none or one that is forgotten."""
    through = _come_before(plan, followed_commands, echoes)
    tick = _at(plan.command_tick[followed_commands], through - 1)
    newest = np.searchsorted(plan.tick_ns, echoes.arrival_ns, side="left") - 1
    return np.where(newest - tick < RING_SIZE, tick, -1)


def _come_before(plan: Plan, commands: IntArray, echoes: Arrivals) -> IntArray:
    """Return how many of some commands have come when the sample of each echo is taken."""
    sample_ns = plan.sample_ns[echoes.sample]
    command_tick = plan.command_tick[commands]
    due_ns = plan.command_due_ns[commands]
    through = np.searchsorted(due_ns, sample_ns, side="right")
    sent_ns = _at(plan.tick_ns[command_tick], np.arange(-1, len(command_tick)))
    # What is sent at the instant of a sample acts after it, even without any latency.
    while (is_later := sent_ns[through] == sample_ns).any():
        through = through - is_later
    return through


def _is_ignoring(
    plant: PlantSettings, plan: Plan, steering: _Steering, echoes: Arrivals
) -> NDArray[np.bool_]:
    """Return whether commands do not decide, by the steering's own word, in each echo."""
    guard = design_guard(plant.safety, plant.vehicle, plant.actuator)
    sample_ns = plan.sample_ns[echoes.sample]
    newest = _come_before(plan, np.arange(len(plan.command_due_ns)), echoes) - 1
    is_silent = sample_ns - _at(plan.command_due_ns, newest) >= guard.silence_ns
    is_held = (newest >= 0) & (is_silent | ~_at(steering.is_in_control, newest, 1))
    is_ordered = sample_ns - plan.motion_start_ns >= guard.override_ns
    return np.asarray(is_held | is_ordered)


def _held(sample: IntArray, tick: IntArray, samples: int) -> IntArray:
    """Return what is taken to be in effect at every sample: that of the newest echo before it."""
    return np.asarray(_at(tick, np.searchsorted(sample, np.arange(samples), side="right") - 1))


def _delays(
    params: LinkParams,
    timeout_ns: int,
    echoes: Arrivals,
    tick: IntArray,
    is_ignoring: NDArray[np.bool_],
) -> FloatArray:
    is_late = np.diff(echoes.arrival_ns, prepend=echoes.arrival_ns[:1]) > timeout_ns
    delays_ns = _run_delays(params, NO_DELAY, echoes.sample, tick, is_late, is_ignoring)
    return np.asarray(delays_ns, dtype=np.float64)


@compiled
def _run_delays(
    params: LinkParams, none: DelayState, sample: Any, tick: Any, is_late: Any, is_ignoring: Any
) -> Any:
    """Return the delay after each echo; after a late one it is measured anew."""
    delay_ns = np.empty(len(sample))
    x = none
    for index in range(len(sample)):
        if is_late[index]:
            x = none
        if not is_ignoring[index]:
            x = delay_step(params, x, sample[index], tick[index])
        delay_ns[index] = delay_of(params, x, sample[index])
    return delay_ns


def _noise(plant: PlantSettings, samples: int) -> tuple[FloatArray, FloatArray]:
    """Return what the sensors add to heading error [rad] and yaw rate [rad/s]."""
    noise = plant.sensor_noise
    deviations = (noise.heading_error_rad, noise.yaw_rate_rad_s)
    if not any(deviations):
        return np.zeros(samples), np.zeros(samples)
    uniforms = first_uniforms(plant.seed, Channel.SENSOR_NOISE, 3 * samples)
    heading, yaw_rate = (
        deviation * normal_scores(uniforms[column::3])
        for column, deviation in enumerate(deviations, 1)
    )
    return heading, yaw_rate
