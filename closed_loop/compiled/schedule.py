"""The effect of the network on a run, computed beforehand: which frame arrives when.

It depends on the settings and the seed alone, not on where the vehicle is, because latencies and
losses are drawn from streams of their own. Whether the controller accepts a measurement, and which
mode it is in, also follow from the arrivals alone; the controller's own classes decide both.

The controller's status messages are left out, because control does not depend on them.
"""

from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from ...controller.history.history import HistoryParams, empty_history
from ...controller.history.plan import ROW_LENGTH
from ...controller.law_interface import History
from ...controller.node.modes import Supervisor, supervision_of
from ...controller.settings import ControllerSettings
from ...dbc.codec.counter_check import CounterCheck
from ...dbc.codec.counter_rule import CounterResult, CounterRule
from ...dbc.codec.protection import COUNTERS, HALF
from ...dbc.messages import (
    LateralError,
    Message,
    Mode,
    PathAhead,
    SteeringStatus,
    VehicleState,
    limits,
    resolutions,
)
from ...dbc.reception import cycle_ns
from ...plant_emulator.network.random_streams import Stream, first_uniforms
from ...plant_emulator.sensors.path_ahead import CURVATURES, VALUES, spacing_m
from ...plant_emulator.sensors.sampling import samples_per_vehicle_state
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.vehicle.moving_vehicle import AnyMotionParams
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.node import NEVER_NS, NS_PER_S
from .along_path import curvatures_ahead_1_m
from .law_input import Inbox, Uplink, quantised
from .loop_records import Segment
from .network import Frames, normal_scores, passages
from .step_functions import register_steps

_MESSAGES: dict[Uplink, type[Message]] = {
    Uplink.LATERAL_ERROR: LateralError,
    Uplink.STEERING_STATUS: SteeringStatus,
    Uplink.VEHICLE_STATE: VehicleState,
    Uplink.PATH_AHEAD: PathAhead,
}
SAMPLES_WITHOUT_ARRIVAL_MAX = 100_000
"""A network that delivers none of this many samples counts as one that loses every frame."""


class RunSchedule(NamedTuple):
    """The instants of a run; ``loop_records.Instants`` describes the first arrays.

    ``motion_s``   time of motion at each sample, 0 before it
    ``time_s``     of each sample since the motion's start, shape (samples since then,)
    ``tick_s``     of each tick, from the start of the run
    ``segments``   the controller's modes, in order
    ``end_ns``     when the last sample is taken
    ``commands_lost``      by the network, of the first ticks, shape (ticks + 1,)
    ``measurements_lost``  of the first samples, shape (samples + 1,): of all messages
    ``measurements``       that the controller accepts, and when
    """

    tick_ns: IntArray
    tick_sample: IntArray
    command_due_ns: IntArray
    command_tick: IntArray
    sample_ns: IntArray
    noise_m: FloatArray
    command_latency_ns: IntArray
    motion_s: FloatArray
    time_s: FloatArray
    tick_s: FloatArray
    segments: tuple[Segment, ...]
    motion_start_ns: int
    end_ns: int
    commands_lost: IntArray
    measurements_lost: IntArray
    measurements: "Measurements"


class Arrivals(NamedTuple):
    """Frames of one message that the controller accepts: when each arrives, of which sample.

    ``lost``  how many frames of all messages of the first samples are lost, shape (samples + 1,)
    """

    arrival_ns: IntArray
    sample: IntArray
    lost: IntArray


class Measurements:
    """The plant's messages as the controller accepts them; each is computed once for all runs."""

    def __init__(
        self,
        plant: PlantSettings,
        controller: ControllerSettings,
        samples: int,
        motion_start_ns: int,
        tick_ns: IntArray,
    ) -> None:
        self._plant, self._rule, self._limits = plant, controller.counters, controller.age_limits
        self._samples, self._motion_start_ns = samples, motion_start_ns
        self._tick_ns = tick_ns

    def arrivals(self, message: Uplink) -> Arrivals:
        """Return the arrivals of one message."""
        return arrivals_of(message, self._plant, self._rule, self._samples, self._motion_start_ns)

    def _in_use(self, message: Uplink) -> tuple[IntArray, IntArray]:
        """Return the sample of the newest message at each tick, -1 for none, and its age [ns]."""
        arrivals = self.arrivals(message)
        in_use = np.searchsorted(arrivals.arrival_ns, self._tick_ns, side="right")
        age_ns = self._tick_ns - np.append(0, arrivals.arrival_ns)[in_use]
        return np.append(-1, arrivals.sample)[in_use], age_ns

    @cached_property
    def vehicle_in_use(self) -> tuple[IntArray, IntArray]:
        """The sample of the VEHICLE_STATE in use at each tick, -1 for none; whether it is stale."""
        sample, age_ns = self._in_use(Uplink.VEHICLE_STATE)
        return sample, (age_ns > self._limits.vehicle_state_ns).astype(np.int64)

    @cached_property
    def speed_known_ns(self) -> int:
        """When the first VEHICLE_STATE arrives."""
        return int(self.arrivals(Uplink.VEHICLE_STATE).arrival_ns.min(initial=NEVER_NS))

    @cached_property
    def status_in_use(self) -> IntArray:
        """The sample of the STEERING_STATUS in use at each tick, -1 for none that is fresh."""
        sample, age_ns = self._in_use(Uplink.STEERING_STATUS)
        return np.where(age_ns <= self._limits.steering_status_ns, sample, -1)

    @cached_property
    def received(self) -> tuple[IntArray, IntArray, IntArray, FloatArray, FloatArray]:
        """The first arrays of ``Inbox``, from ``arrival_ns`` on."""
        each = [self.arrivals(message) for message in Uplink]
        message = np.repeat(list(Uplink), [len(arrivals.sample) for arrivals in each])
        sample = np.concatenate([arrivals.sample for arrivals in each])
        arrival_ns = np.concatenate([arrivals.arrival_ns for arrivals in each])
        order = np.lexsort((message, sample, arrival_ns))
        heading_rad, yaw_rate_rad_s = sensor_noise(self._plant, self._samples, slice(1, 3))
        return arrival_ns[order], message[order], sample[order], heading_rad, yaw_rate_rad_s


class NothingArrivesError(ValueError):
    """No measurement reaches the controller, so that it never steers and the run never ends."""


def schedule_run(plant: PlantSettings, controller: ControllerSettings) -> RunSchedule:
    """Schedule a run. Raises NothingArrivesError."""
    register_steps()
    first_tick_ns = _first_tick_ns(plant, controller)
    motion_start_ns = first_tick_ns if plant.start_on_first_command else 0
    sensor_ns, period_ns = plant.sensor_period_ns, controller.period_ns
    samples = -(-(motion_start_ns + plant.duration_ns) // sensor_ns) + 1
    end_ns = (samples - 1) * sensor_ns
    rule = controller.counters
    arrivals = arrivals_of(Uplink.LATERAL_ERROR, plant, rule, samples, motion_start_ns)
    tick_ns = np.arange(first_tick_ns, end_ns + 1, period_ns)
    in_use = np.searchsorted(arrivals.arrival_ns, tick_ns, side="right") - 1
    commands = Frames(
        tick_ns, np.maximum(tick_ns - motion_start_ns, 0), np.ones(len(tick_ns), dtype=np.bool_)
    )
    down = passages(plant.latency.downlink, plant.seed, Stream.DOWNLINK, commands)
    through = down.due_ns <= end_ns
    sample_ns = np.arange(samples) * sensor_ns
    # The sample at the instant of the first command is taken before that command.
    is_moving = sample_ns >= motion_start_ns + int(plant.start_on_first_command)
    motion_ns = np.maximum(sample_ns - motion_start_ns, 0)
    return RunSchedule(
        tick_ns=tick_ns,
        tick_sample=arrivals.sample[in_use],
        command_due_ns=down.due_ns[through],
        command_tick=down.frame[through],
        sample_ns=sample_ns,
        noise_m=sensor_noise(plant, samples, slice(1))[0],
        command_latency_ns=down.latency_ns[through],
        motion_s=motion_ns / NS_PER_S,
        time_s=np.multiply(motion_ns[is_moving], 1e-9),
        tick_s=np.multiply(tick_ns, 1e-9),
        segments=_segments(controller, arrivals, in_use, tick_ns),
        motion_start_ns=motion_start_ns,
        end_ns=end_ns,
        commands_lost=np.append(0, np.cumsum(down.is_lost)),
        measurements_lost=arrivals.lost,
        measurements=Measurements(plant, controller, samples, motion_start_ns, tick_ns),
    )


def _first_tick_ns(plant: PlantSettings, controller: ControllerSettings) -> int:
    """Return the tick at which the controller stops waiting."""
    timeout_ns = supervision_of(controller).measurement_timeout_ns
    period_ns, samples = controller.period_ns, 1
    rule = controller.counters
    while samples <= SAMPLES_WITHOUT_ARRIVAL_MAX:
        # Frames after the start have another time of motion, but none of them is the first.
        start_ns = NEVER_NS if plant.start_on_first_command else 0
        arrival_ns = arrivals_of(Uplink.LATERAL_ERROR, plant, rule, samples, start_ns).arrival_ns
        tick_ns = -(-arrival_ns // period_ns) * period_ns
        known_ns = (samples - 1) * plant.sensor_period_ns  # later ones may overtake beyond that
        fresh = (tick_ns - arrival_ns <= timeout_ns) & (tick_ns <= known_ns)
        if fresh.any():
            return int(tick_ns[np.argmax(fresh)])
        samples *= 4
    raise NothingArrivesError(
        f"no measurement came into use in {SAMPLES_WITHOUT_ARRIVAL_MAX} samples: the uplink loses "
        "them, or they overtake each other by more than controller.supervision.counter_lead_ms"
    )


def arrivals_of(
    message: Uplink, plant: PlantSettings, rule: CounterRule, samples: int, motion_start_ns: int
) -> Arrivals:
    """Return the arrivals of one message of the first samples."""
    every = samples_per_vehicle_state(plant.sensor_period_ns)
    # LATERAL_ERROR and STEERING_STATUS of every sample, others of some: all draw.
    messages = np.full(samples, 2)
    messages[::every] = 3 if plant.path_ahead is None else 4
    first = np.append(0, np.cumsum(messages))
    sample = np.repeat(np.arange(samples), messages)
    came_ns = sample * plant.sensor_period_ns
    is_wanted = np.arange(len(sample)) - np.repeat(first[:-1], messages) == message
    frames = Frames(came_ns, np.maximum(came_ns - motion_start_ns, 0), is_wanted)
    up = passages(plant.latency.uplink, plant.seed, Stream.UPLINK, frames)
    number = sample[up.frame] // (every if message >= Uplink.VEHICLE_STATE else 1)
    rule = rule._replace(period_ns=cycle_ns(_MESSAGES[message]))
    lost = np.append(0, np.cumsum(up.is_lost))[first]
    return _accepted(rule, number, Arrivals(up.due_ns, sample[up.frame], lost))


def _accepted(rule: CounterRule, number: IntArray, arrived: Arrivals) -> Arrivals:
    """Return the frames of a message that the counter rule accepts."""
    steps = np.diff(number)
    # As the rule's bound with the longest period that it may measure.
    is_explained = (steps - 1) * rule.period_ns <= rule.lead_ns + np.diff(arrived.arrival_ns)
    if ((steps >= 1) & (steps < HALF) & is_explained).all():
        return arrived
    check = CounterCheck(rule)
    is_accepted = [
        check.check(count, now_ns) is CounterResult.ACCEPTED
        for count, now_ns in zip(
            (number % COUNTERS).tolist(), arrived.arrival_ns.tolist(), strict=True
        )
    ]
    return arrived._replace(
        arrival_ns=arrived.arrival_ns[is_accepted], sample=arrived.sample[is_accepted]
    )


def _segments(
    controller: ControllerSettings, arrivals: Arrivals, in_use: IntArray, tick_ns: IntArray
) -> tuple[Segment, ...]:
    """Return the modes of the ticks; the first tick ends the wait."""
    supervision = supervision_of(controller)
    arrival_ns = arrivals.arrival_ns
    is_fresh = tick_ns - arrival_ns[in_use] <= supervision.measurement_timeout_ns
    if is_fresh.all():
        return (Segment(int(Mode.ACTIVE), 0, len(tick_ns), False),)
    supervisor, arrived = Supervisor(supervision, 0), 0
    before_ns: int | None = None
    entered: list[tuple[Mode, int]] = []
    for tick, (now_ns, newest) in enumerate(zip(tick_ns.tolist(), in_use.tolist(), strict=True)):
        while arrived <= newest:
            arrived_ns = int(arrival_ns[arrived])
            supervisor.on_measurement(before_ns, arrived_ns)
            before_ns = arrived_ns
            arrived += 1
        mode = supervisor.move_on(before_ns, now_ns)
        if mode is not None:
            entered.append((mode, tick))
    ends = [first for _, first in entered[1:]] + [len(tick_ns)]
    return tuple(
        Segment(int(mode), first, end, index > 0 and entered[index - 1][0] is not Mode.ACTIVE)
        for index, ((mode, first), end) in enumerate(zip(entered, ends, strict=True))
    )


def sensor_noise(plant: PlantSettings, samples: int, columns: slice) -> list[FloatArray]:
    """Return the noise of each sample, of some of lateral error, heading error and yaw rate."""
    noise = plant.sensor_noise
    deviations = [noise.lateral_error_m, noise.heading_error_rad, noise.yaw_rate_rad_s][columns]
    if not any(deviations):
        return [np.zeros(samples) for _ in deviations]
    uniforms = first_uniforms(plant.seed, Stream.SENSOR_NOISE, 3 * samples).reshape(-1, 3).T
    scores = map(normal_scores, uniforms[columns])
    return [deviation * each for deviation, each in zip(deviations, scores, strict=True)]


def inbox_of(
    plant: PlantSettings,
    controller: ControllerSettings,
    schedule: RunSchedule,
    motion: AnyMotionParams,
) -> Inbox:
    """Return the inbox of one run's law, with all that does not depend on how the vehicle moves."""
    samples = len(schedule.sample_ns)
    return Inbox(
        HistoryParams(controller.loop_delay, controller.age_limits),
        empty_rings(keeps_plans=controller.law_record.plan is not None),
        *schedule.measurements.received,
        measured_heading_rad=np.empty(samples),
        measured_yaw_rate_rad_s=np.empty(samples),
        measured_curvature_1_m=np.empty(samples),
        wheel_rad=np.empty(samples),
        status=np.empty(samples, dtype=np.int64),
        measured_speed_m_s=np.full(samples, quantised_speed_m_s(motion.speed_m_s)),
        periods_per_sample=controller.link.sensor_period_s / (controller.period_ns / NS_PER_S),
        buffer=np.zeros(ROW_LENGTH),
        samples_per_path=samples_per_vehicle_state(plant.sensor_period_ns),
        path_spacing_m=_path_spacing_m(plant),
        path_ahead_1_m=_paths_ahead_1_m(plant, schedule, motion),
        played_rad=np.full(samples if controller.law_record.plan is not None else 0, np.nan),
    )


def _path_spacing_m(plant: PlantSettings) -> float:
    """Return the spacing of PATH_AHEAD as the wire carries it, 0 where it is not sent [m]."""
    if plant.path_ahead is None:
        return 0.0
    wanted_m = spacing_m(plant.vehicle.speed_m_s, plant.path_ahead.reach_s)
    return float(quantised(wanted_m, resolutions(PathAhead)["path_spacing_m"]))


def _paths_ahead_1_m(
    plant: PlantSettings, schedule: RunSchedule, motion: AnyMotionParams
) -> FloatArray:
    """Return the values of each PATH_AHEAD, as on the wire; shape (messages, values)."""
    if plant.path_ahead is None:
        return np.empty((0, VALUES))
    every = samples_per_vehicle_state(plant.sensor_period_ns)
    spacing = spacing_m(plant.vehicle.speed_m_s, plant.path_ahead.reach_s)
    places_m = motion.speed_m_s * schedule.motion_s[::every]
    rows = curvatures_ahead_1_m(motion.path, places_m, spacing, VALUES, *CURVATURES)
    resolution_1_m = resolutions(PathAhead)["curvature_0_1_m"]
    return np.asarray(np.rint(rows / resolution_1_m) * resolution_1_m)


def quantised_speed_m_s(speed_m_s: float) -> float:
    """Return the speed as VEHICLE_STATE carries it [m/s]."""
    highest_m_s = limits(VehicleState)["speed_m_s"].maximum
    return float(quantised(min(speed_m_s, highest_m_s), resolutions(VehicleState)["speed_m_s"]))


def empty_rings(*, keeps_plans: bool) -> History:
    """Return the initial history of ``BusHistory``, as arrays."""
    rings, arrays = _empty_rings(keeps_plans)
    return rings._replace(**{name: array.copy() for name, array in arrays.items()})


@lru_cache
def _empty_rings(keeps_plans: bool) -> tuple[History, dict[str, Any]]:
    rings = empty_history(keeps_plans=keeps_plans)
    lists = {name: ring for name, ring in rings._asdict().items() if isinstance(ring, list)}
    return rings, {name: np.array(ring) for name, ring in lists.items()}
