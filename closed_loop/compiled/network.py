"""The network over a whole run at once: which frames come through, when, in which order.

The result equals that of ``plant_emulator.network.latency_line``, frame by frame, from the same
streams, to the last bit (``test_compiled_run``). Three quantiles and the AR(1) process are
rewritten for arrays, and the queue becomes a sort:

    order of leaving    by due time; frames due together in order of arrival
    newest wins         drops a frame that leaves after a later one of its message
    in order            no frame is due before an earlier one of its message
"""

import statistics
from collections.abc import Sequence
from itertools import repeat
from math import exp
from typing import Any, NamedTuple

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
from ...plant_emulator.network.latency_distributions import RESOLUTION_S, Distribution
from ...plant_emulator.network.latency_draw import uniform_of_score
from ...plant_emulator.network.latency_over_time import profile_at
from ...plant_emulator.network.loss import LossParams, bernoulli, gilbert, loss_step
from ...plant_emulator.network.random_streams import Stream, first_uniforms
from ...plant_emulator.network.settings import LatencySettings, Order
from ...plant_emulator.sensors.sampling import samples_per_vehicle_state
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import BoolArray, FloatArray, IntArray
from ...runtime.node import NS_PER_S
from .compilation import compiled
from .law_input import Uplink
from .step_functions import register

register(loss_step)


class Frames(NamedTuple):
    """Frames that enter a line, in order; each array has shape (frames,).

    ``motion_ns``  time of motion at which each enters
    ``is_wanted``  frames of the message whose passage is asked for; all draw from the stream
    """

    came_ns: IntArray
    motion_ns: IntArray
    is_wanted: BoolArray


class Passages(NamedTuple):
    """Wanted frames that leave the line, in the order of leaving.

    ``frame``    index among all frames that entered
    ``is_lost``  of all these, those that the line lost
    """

    due_ns: IntArray
    frame: IntArray
    latency_ns: IntArray
    is_lost: BoolArray


class _Network(NamedTuple):
    """Mean, spread [s] and loss for each frame; shape (frames,), or (1,) where constant."""

    mean_s: FloatArray
    spread_s: FloatArray
    loss: FloatArray


def passages(settings: LatencySettings, seed: int, channel: Stream, frames: Frames) -> Passages:
    """Pass frames through a line whose stream is ``channel`` of ``seed``."""
    count = len(frames.came_ns)
    network = _network(settings, frames)
    draws = (
        first_uniforms(seed, channel, 2 * count)
        if _has_jitter(settings) or _is_lossy(settings)
        else np.zeros(2 * count)
    )
    is_lost = _losses(settings, network.loss, draws[0::2])
    u = draws[1::2]
    if settings.correlation_time_s > 0.0 and _has_jitter(settings):
        u = _correlated(u, frames.came_ns, settings.correlation_time_s)
    if (traced_s := _traced_s(settings, frames)) is not None:
        is_lost |= np.isnan(traced_s)
    index = np.flatnonzero(~is_lost & frames.is_wanted)
    latency_ns = _latencies_ns(settings, network, u, traced_s, index)
    came_ns = frames.came_ns[index]
    due_ns = came_ns + latency_ns
    if settings.order is Order.IN_ORDER:
        due_ns = np.maximum.accumulate(due_ns)
    leaving = np.argsort(due_ns, kind="stable")
    if settings.order is Order.NEWEST_WINS and len(leaving):
        newest = np.maximum.accumulate(leaving)
        leaving = leaving[leaving == newest]
    return Passages(due_ns[leaving], index[leaving], (due_ns - came_ns)[leaving], is_lost)


def _is_lossy(settings: LatencySettings) -> bool:
    return settings.loss > 0.0 or any(point.loss > 0.0 for point in settings.schedule)


def _has_jitter(settings: LatencySettings) -> bool:
    return not settings.has_trace and settings.model is not Distribution.CONSTANT


def _network(settings: LatencySettings, frames: Frames) -> _Network:
    if not settings.schedule:
        return _Network(
            np.array([settings.mean_s]), np.array([settings.spread_s]), np.array([settings.loss])
        )
    instants, of_frame = np.unique(frames.motion_ns, return_inverse=True)
    rows = [
        profile_at(settings.profile, settings.schedule_shape, motion_ns / NS_PER_S)[1:]
        for motion_ns in instants.tolist()
    ]
    return _Network(*np.array(rows, dtype=np.float64).reshape(-1, 3)[of_frame].T)


def _losses(settings: LatencySettings, loss: FloatArray, u: FloatArray) -> BoolArray:
    if not _is_lossy(settings):
        return np.zeros(len(u), dtype=np.bool_)
    shares, of_frame = np.unique(loss, return_inverse=True)
    chains = np.array([_chain(settings, share) for share in shares.tolist()]).reshape(-1, 4)
    return np.asarray(_run_chain(chains[of_frame], u, len(loss) > 1), dtype=np.bool_)


def _chain(settings: LatencySettings, loss: float) -> LossParams:
    if settings.burst_frames is None:
        return bernoulli(loss)
    return gilbert(loss, settings.burst_frames)


@compiled
def _run_chain(chains: Any, u: Any, has_one_each: Any) -> Any:
    is_lost = np.zeros(len(u), dtype=np.bool_)
    in_burst = False
    for frame in range(len(u)):
        row = chains[frame] if has_one_each else chains[0]
        in_burst, is_lost[frame] = loss_step(
            LossParams(row[0], row[1], row[2], row[3]), in_burst, u[frame]
        )
    return is_lost


def _correlated(u: FloatArray, came_ns: IntArray, correlation_time_s: float) -> FloatArray:
    """Return the uniforms of the AR(1) process: ``correlated_score``, ``uniform_of_score``."""
    elapsed_ns, of_frame = np.unique(np.diff(came_ns), return_inverse=True)
    # An infinite time precedes the first frame. math.exp, because implementations of exp differ.
    coefficients = [exp(-(value / NS_PER_S) / correlation_time_s) for value in elapsed_ns.tolist()]
    phi = np.concatenate(([0.0], np.array(coefficients)[of_frame]))[: len(u)]
    scores = _run_scores(phi, np.sqrt(1.0 - phi * phi) * normal_scores(u))
    return np.array([uniform_of_score(score) for score in scores.tolist()])


@compiled
def _run_scores(phi: Any, innovations: Any) -> Any:
    scores = np.empty_like(innovations)
    score = 0.0
    for frame in range(len(innovations)):
        score = phi[frame] * score + innovations[frame]
        scores[frame] = score
    return scores


def _traced_s(settings: LatencySettings, frames: Frames) -> FloatArray | None:
    """Return the latency of each frame by the trace, if there is one; shape (frames,)."""
    trace = settings.trace()
    if trace is None:
        return None
    _, first, sample = np.unique(frames.came_ns, return_index=True, return_inverse=True)
    motion_s = (frames.motion_ns[first] / NS_PER_S).tolist()
    of_sample = [trace.latency_s(number, time_s) for number, time_s in enumerate(motion_s)]
    return np.array(of_sample, dtype=np.float64)[sample]


def _latencies_ns(
    settings: LatencySettings,
    network: _Network,
    u: FloatArray,
    traced_s: FloatArray | None,
    wanted: IntArray,
) -> IntArray:
    """Return the latency of the frames ``wanted`` [ns]; the arrays are of all frames."""
    if traced_s is not None:
        return _whole_ns(traced_s[wanted])
    mean_s, spread_s = (
        np.broadcast_to(values, u.shape)[wanted] for values in (network.mean_s, network.spread_s)
    )
    if settings.model is Distribution.CONSTANT:
        return _whole_ns(mean_s)
    if settings.model is Distribution.GAMMA:
        return _whole_ns(_gamma_quantiles(u[wanted], mean_s, spread_s))
    if settings.model is Distribution.NORMAL:
        return _whole_ns(np.maximum(0.0, mean_s + spread_s * normal_scores(u[wanted])))
    quantile = settings.quantile
    return _whole_ns(
        np.array(list(map(quantile, u[wanted].tolist(), mean_s.tolist(), spread_s.tolist())))
    )


def _inverse(u: float, _mean: float, _deviation: float) -> float:
    return statistics.NormalDist().inv_cdf(u)


def normal_scores(u: FloatArray) -> FloatArray:
    """Return Φ⁻¹(u) of an array, as ``NormalDist.inv_cdf`` computes it.

    The method's checks around this function cost a seventh of a jittery schedule's time.
    """
    inverse = getattr(statistics, "_normal_dist_inv_cdf", _inverse)
    return np.fromiter(map(inverse, u.tolist(), repeat(0.0), repeat(1.0)), np.float64, len(u))


def _gamma_quantiles(u: FloatArray, mean_s: FloatArray, spread_s: FloatArray) -> FloatArray:
    """Return ``gamma_quantile`` of arrays: one call of scipy costs as much as a hundred values."""
    from scipy.special import gammaincinv

    mean_s, spread_s = np.broadcast_arrays(mean_s, spread_s)
    is_spread = np.minimum(mean_s, spread_s) >= RESOLUTION_S
    safe_mean_s = np.where(is_spread, mean_s, 1.0)
    shape = (safe_mean_s / np.where(is_spread, spread_s, 1.0)) ** 2
    quantiles = safe_mean_s / shape * gammaincinv(shape, u)
    return np.asarray(np.where(is_spread, quantiles, mean_s), dtype=np.float64)


def _whole_ns(seconds: FloatArray) -> IntArray:
    return np.rint(seconds * NS_PER_S).astype(np.int64)


_MESSAGES: dict[Uplink, type[Message]] = {
    Uplink.LATERAL_ERROR: LateralError,
    Uplink.STEERING_STATUS: SteeringStatus,
    Uplink.VEHICLE_STATE: VehicleState,
    Uplink.PATH_AHEAD: PathAhead,
    Uplink.STEERING_FORCE: SteeringForce,
}
UPLINKS = {kind: message for message, kind in _MESSAGES.items()}


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


def in_use_at(arrivals: Arrivals, at_ns: IntArray) -> tuple[IntArray, IntArray]:
    """Return the sample of the newest frame at each time, -1 for none, and its age [ns]."""
    newest = np.searchsorted(arrivals.arrival_ns, at_ns, side="right")
    age_ns = at_ns - np.append(0, arrivals.arrival_ns)[newest]
    return np.append(-1, arrivals.sample)[newest], age_ns


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
    """Return what reaches the plant up to ``end_ns``, and how many frames are lost.

    Those that are lost are counted up to each command, shape (commands + 1,).

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
    before_next = np.append(np.searchsorted(came_ns, came_ns[kind == 0][1:]), len(came_ns))
    lost = np.append(0, np.append(0, np.cumsum(down[0].is_lost))[before_next])
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
