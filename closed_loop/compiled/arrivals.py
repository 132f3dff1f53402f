"""Arrivals of messages at the controller, the hand wheel and the plant, for a whole run at once."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...dbc.codec.counter_check import CounterCheck
from ...dbc.codec.counter_rule import CounterResult, CounterRule
from ...dbc.codec.protection import COUNTERS, HALF
from ...dbc.messages import (
    LateralError,
    Message,
    PathAhead,
    SteeringForce,
    SteeringStatus,
    VehicleState,
)
from ...dbc.reception import cycle_ns
from ...plant_emulator.network.random_streams import Stream, first_uniforms
from ...plant_emulator.sensors.sampling import samples_per_vehicle_state
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray, IntArray
from .law_input import Uplink
from .network import Frames, normal_scores, passages

_MESSAGES: dict[Uplink, type[Message]] = {
    Uplink.LATERAL_ERROR: LateralError,
    Uplink.STEERING_STATUS: SteeringStatus,
    Uplink.VEHICLE_STATE: VehicleState,
    Uplink.PATH_AHEAD: PathAhead,
    Uplink.STEERING_FORCE: SteeringForce,
}


class Arrivals(NamedTuple):
    """Frames of one message that the controller accepts: when each arrives, of which sample.

    ``lost``  how many frames of all messages of the first samples are lost, shape (samples + 1,)
    """

    arrival_ns: IntArray
    sample: IntArray
    lost: IntArray


class ToPlant(NamedTuple):
    """Messages that reach the plant, in the order of their leaving.

    ``kind``   0 for a command, 1 for HAND_WHEEL_FEEDBACK, 2 for HAND_WHEEL_STATE
    ``number`` of the tick or the cycle at which it was sent
    """

    came_ns: IntArray
    due_ns: IntArray
    kind: IntArray
    number: IntArray
    latency_ns: IntArray


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
    if plant.steering_force is not None:  # read after a sample of the same instant
        force_ns = np.arange(0, came_ns[-1] + 1, plant.force_period_ns)
        at = np.searchsorted(came_ns, force_ns, side="right")
        is_force = message is Uplink.STEERING_FORCE
        sample, came_ns = (
            np.insert(sample, at, np.arange(len(at))),
            np.insert(came_ns, at, force_ns),
        )
        is_wanted = np.insert(is_wanted, at, is_force)
        first += np.searchsorted(force_ns, np.arange(samples + 1) * plant.sensor_period_ns)
    frames = Frames(came_ns, np.maximum(came_ns - motion_start_ns, 0), is_wanted)
    up = passages(plant.latency.uplink, plant.seed, Stream.UPLINK, frames)
    is_of_some = message in (Uplink.VEHICLE_STATE, Uplink.PATH_AHEAD)
    number = sample[up.frame] // (every if is_of_some else 1)
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


def to_plant_of(
    plant: PlantSettings, sent: Sequence[tuple[int, IntArray]], motion_start_ns: int, end_ns: int
) -> tuple[ToPlant, IntArray]:
    """Return what reaches the plant up to ``end_ns``, and how many commands are lost.

    ``sent``  the first index of each kind, and when its messages are sent [ns]
    """
    kinds = np.repeat(np.arange(len(sent)), [len(came_ns) for _, came_ns in sent])
    indices = np.concatenate([first + np.arange(len(came_ns)) for first, came_ns in sent])
    sent_ns = np.concatenate([came_ns for _, came_ns in sent])
    order = np.argsort(sent_ns, kind="stable")
    came_ns, kind, index = sent_ns[order], kinds[order], indices[order]
    motion_ns = np.maximum(came_ns - motion_start_ns, 0)
    down = [
        passages(
            plant.latency.downlink,
            plant.seed,
            Stream.DOWNLINK,
            Frames(came_ns, motion_ns, kind == number),
        )
        for number in range(len(sent))
    ]
    due_ns, frame, latency_ns = (
        np.concatenate([getattr(each, name) for each in down])
        for name in ("due_ns", "frame", "latency_ns")
    )
    through = due_ns <= end_ns
    due_ns, frame, latency_ns = due_ns[through], frame[through], latency_ns[through]
    # Of one kind they have their order already; kinds that are due together go as they came.
    leaving = np.lexsort((frame, due_ns)) if len(sent) > 1 else np.arange(len(frame))
    frame = frame[leaving]
    lost = np.append(0, np.cumsum(down[0].is_lost[kind == 0]))
    left = came_ns[frame], due_ns[leaving], kind[frame], index[frame], latency_ns[leaving]
    return ToPlant(*left), lost


def sensor_noise(plant: PlantSettings, samples: int, columns: slice) -> list[FloatArray]:
    """Return the noise of each sample, of some of lateral error, heading error and yaw rate."""
    noise = plant.sensor_noise
    deviations = [noise.lateral_error_m, noise.heading_error_rad, noise.yaw_rate_rad_s][columns]
    if not any(deviations):
        return [np.zeros(samples) for _ in deviations]
    uniforms = first_uniforms(plant.seed, Stream.SENSOR_NOISE, 3 * samples).reshape(-1, 3).T
    scores = map(normal_scores, uniforms[columns])
    return [deviation * each for deviation, each in zip(deviations, scores, strict=True)]
