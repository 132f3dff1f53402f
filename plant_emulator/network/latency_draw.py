"""Draw of one frame's fate in the network: its latency, or its loss.

For every frame two uniforms are drawn, in this order, whether they are needed or not:

    1. lost or not   (``plant_emulator.network.loss``)
    2. latency       (``plant_emulator.network.latency_distributions``)

so that runs with the same seed meet the same network, and a distribution with a heavier tail makes
every frame later.
"""

from collections.abc import Callable, Iterator
from math import exp, isnan, sqrt
from statistics import NormalDist

from ...runtime.node import NS_PER_S
from .latency_distributions import QUANTILES, Distribution
from .latency_over_time import profile_at
from .loss import LossParams, bernoulli, gilbert, loss_step
from .settings import LatencySettings

_STANDARD_NORMAL = NormalDist()


class LatencyDraw:
    """Draws the latency of each frame of one direction.

    ``stream``    the uniforms of loss and latency of all frames, from one of them on

    ``trace_times_s``  times of the rows of the settings' trace [s]; empty without one
    ``constant_ns``  the one latency of all frames [ns]; None where draws decide
    """

    def __init__(self, settings: LatencySettings, stream: Callable[[int], Iterator[float]]) -> None:
        self._settings = settings
        self._stream, self._uniforms = stream, stream(0)
        self._quantile = settings.quantile
        self._schedule = settings.profile
        self._trace = settings.trace()
        self.trace_times_s = () if self._trace is None else self._trace.times_s
        self._mean_s = settings.mean_s
        self._spread_s = settings.spread_s
        self._loss = self._loss_params(settings.loss)
        self._in_burst = False
        self._score = 0.0
        self._score_ns: int | None = None
        self.constant_ns = self._constant_ns()

    def reconfigure(
        self, model: Distribution, mean_s: float, spread_s: float, loss: float, frames: int
    ) -> None:
        """Change the network from the next frame on; this ends a schedule and a trace.

        ``frames``  how many have come so far. Those of constant latency have drawn nothing
        """
        self._uniforms = self._stream(2 * frames)
        self._quantile = QUANTILES[model]
        self._schedule = ()
        self._trace = None
        self._mean_s = mean_s
        self._spread_s = spread_s
        self._loss = self._loss_params(loss)
        self.constant_ns = self._constant_ns()

    def latency_ns(self, sample: int, now_ns: int, motion_ns: int) -> int | None:
        """Return the latency of the frame; None if it is lost.

        ``sample``  samples that came before; the frames of one come together
        """
        if self._schedule:
            self._follow_schedule(motion_ns)
        loss_u, latency_u = next(self._uniforms), next(self._uniforms)
        self._in_burst, is_lost = loss_step(self._loss, self._in_burst, loss_u)
        if self._settings.correlation_time_s > 0.0:
            latency_u = self._correlated(latency_u, now_ns)
        latency_s = self._latency_s(latency_u, sample, motion_ns)
        return None if is_lost or isnan(latency_s) else round(latency_s * NS_PER_S)

    def _follow_schedule(self, motion_ns: int) -> None:
        shape, time_s = self._settings.schedule_shape, motion_ns / NS_PER_S
        _, self._mean_s, self._spread_s, loss = profile_at(self._schedule, shape, time_s)
        self._loss = self._loss_params(loss)

    def _constant_ns(self) -> int | None:
        is_drawn = (
            self._quantile is not QUANTILES[Distribution.CONSTANT]
            or self._schedule
            or self._trace is not None
            or self._in_burst
            or self._loss != bernoulli(0.0)
            or self._settings.correlation_time_s > 0.0
        )
        return None if is_drawn else round(self._mean_s * NS_PER_S)

    def _latency_s(self, u: float, sample: int, motion_ns: int) -> float:
        """Return a latency; that of a trace may say, by not being a number, that it was lost."""
        if self._trace is not None:
            return self._trace.latency_s(sample, motion_ns / NS_PER_S)
        return self._quantile(u, self._mean_s, self._spread_s)

    def _correlated(self, u: float, now_ns: int) -> float:
        """Return the uniform of the AR(1) process, which starts in its stationary state."""
        # Infinitely long after any other frame, the first score is independent.
        elapsed_s = float("inf") if self._score_ns is None else (now_ns - self._score_ns) / NS_PER_S
        self._score = correlated_score(self._score, u, elapsed_s, self._settings.correlation_time_s)
        self._score_ns = now_ns
        return uniform_of_score(self._score)

    def _loss_params(self, loss: float) -> LossParams:
        burst_frames = self._settings.burst_frames
        return bernoulli(loss) if burst_frames is None else gilbert(loss, burst_frames)


def correlated_score(
    previous: float, u: float, elapsed_s: float, correlation_time_s: float
) -> float:
    """Advance the AR(1) process behind correlated latencies by one frame.

        z ← φ z + √(1 − φ²) Φ⁻¹(u),   φ = exp(−elapsed / correlation time)

    z stays standard normal, so `uniform_of_score(z)` is a uniform again and the distribution of
    the latencies stays what it was. For frames at a regular period this is AR(1) with the
    constant coefficient φ; tying φ to time gives messages of different periods, and frames sent
    at the same instant, the one state of the network that they share.
    """
    phi = exp(-elapsed_s / correlation_time_s)
    return phi * previous + sqrt(1.0 - phi * phi) * _STANDARD_NORMAL.inv_cdf(u)


def uniform_of_score(score: float) -> float:
    """Return Φ(z), kept off the ends of (0, 1)."""
    return min(max(_STANDARD_NORMAL.cdf(score), 2.0**-54), 1.0 - 2.0**-53)
