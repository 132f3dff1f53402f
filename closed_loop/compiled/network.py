"""A latency line over a whole run at once: which frames come through, when, in which order.

Its result equals that of ``plant_emulator.network.latency_line``, frame by frame, from the same
streams, to the last bit (``test_compiled_run``). Three quantiles and the AR(1) process are
rewritten for arrays, and the queue becomes a sort:

    order of leaving    by due time; frames due together in order of arrival
    newest wins         drops a frame that leaves after a later one of its message
    in order            no frame is due before an earlier one of its message
"""

from math import exp
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from ...plant_emulator.network.latency_distributions import RESOLUTION_S, Distribution
from ...plant_emulator.network.latency_draw import uniform_of_score
from ...plant_emulator.network.latency_over_time import profile_at
from ...plant_emulator.network.loss import LossParams, bernoulli, gilbert, loss_step
from ...plant_emulator.network.random_streams import Stream, first_uniforms
from ...plant_emulator.network.settings import LatencySettings, Order
from ...runtime.array_types import BoolArray, FloatArray, IntArray
from ...runtime.node import NS_PER_S
from .compilation import compiled


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


def normal_scores(u: FloatArray) -> FloatArray:
    """Return Φ⁻¹(u) of an array."""
    return np.array(list(map(NormalDist().inv_cdf, u.tolist())), dtype=np.float64)


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
