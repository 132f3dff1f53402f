"""Stability of the sampled loop with a new random latency for every command.

Each command has its own latency, independent of all others, or is lost. The newest command that has
arrived is held, and overtaken ones are dropped. The age of the held command is then a Markov chain,
and the loop a jump-linear system, as in Jitterbug (Lincoln and Cervin 2002):

    x[k+1] = A_i x[k]        x = (plant, law, u[k-1], ..., u[k-n])        while u[k-i] is held

    X_i = E[x xᵀ 1{i}]       X_j[k+1] = Σ_i P(i → j) A_j X_i[k] A_jᵀ

The second moments decay, the loop is *stable in the mean square*, if and only if the spectral
radius λ of that recursion is below 1; -ln λ/(2T) is the rate at which the root mean square decays.
With a latency that does not vary it is ``SampledLoop.decay_1_s``. Stability in the mean square is
stronger than stability of almost every run: rare runs that grow for long enough can make the mean
square unbounded although every single run decays. The converse cannot happen.

``Arrivals`` defines when commands arrive, in whole periods. Commands are followed up to the age
that is exceeded with a probability below AGE_PROBABILITY_MIN; if it is exceeded, the next command
is held without an arrival.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S
from ..matrices import zero_order_hold
from .linear_system import companion_form, without_idle_states
from .sampled_loop import SLOWEST_DECAY_1_S, SampledLoop
from .stable_delays import Interval, stable_intervals

AGE_PROBABILITY_MIN = 1e-9
"""Rarer events are neglected: shorter latencies, and longer waits for any command."""

LatencyCdf = Callable[[FloatArray], FloatArray]
"""P(latency ≤ t) for latencies t [s], any shape."""


class Arrivals(NamedTuple):
    """When commands arrive if each draws its own, independent latency; in whole control periods.

    With a share p of all commands lost, those that have not arrived after b-1 periods arrive at the
    next with probability

        h_b = (1 - p) (F_b - F_(b-1)) / (1 - (1 - p) F_(b-1)),     F_b = P(latency ≤ b periods)

    A continuous latency is rounded to the nearest whole period, which keeps its mean. A latency of
    zero arrives in the very period it is sent in.

    ``cdf``   P(latency ≤ b periods) for b = 0, 1, ..., ascending; then as the last
    ``loss``  share of commands that never arrive, 0 to below 1
    """

    cdf: FloatArray
    loss: float = 0.0


def gamma_cdf(mean_s: float, spread_s: float) -> LatencyCdf:
    """Return the gamma distribution with a mean and a standard deviation > 0 [s]."""
    from scipy.special import gammainc

    shape = (mean_s / spread_s) ** 2
    return lambda t: np.asarray(gammainc(shape, np.maximum(t, 0.0) * shape / mean_s))


def constant_cdf(mean_s: float) -> LatencyCdf:
    """Return the latency that does not vary."""
    return lambda t: np.where(t >= mean_s * (1.0 - 1e-12), 1.0, 0.0)


def arrivals(cdf: LatencyCdf, period_ns: int, loss: float = 0.0) -> Arrivals:
    """Return the arrivals of a latency rounded to whole periods, as far as its tail matters."""
    count = 64
    while True:
        values = cdf((np.arange(count, dtype=np.float64) + 0.5) * (period_ns / NS_PER_S))
        if values[-1] >= 1.0 - 1e-3 * AGE_PROBABILITY_MIN or count >= 1 << 16:
            needed = int(np.searchsorted(values, 1.0 - 1e-3 * AGE_PROBABILITY_MIN)) + 1
            return Arrivals(values[:needed], loss)
        count *= 2


def hazards_by_age(when: Arrivals) -> FloatArray:
    """Return h_b for the ages to follow, shape (ages,).

    Followed are commands up to the age at which, but for AGE_PROBABILITY_MIN, a newer one has come.
    Raises ValueError where none ever comes.
    """
    arrived = np.where(when.cdf < AGE_PROBABILITY_MIN, 0.0, when.cdf) * (1.0 - when.loss)
    if not len(arrived) or not arrived[-1] > 0.0:
        raise ValueError("no command ever arrives")
    still_out, ages = 1.0, 0
    while still_out >= AGE_PROBABILITY_MIN:  # none of so many ages has arrived
        still_out *= 1.0 - arrived[min(ages, len(arrived) - 1)]
        ages += 1
    padded = np.concatenate([[0.0], arrived, np.full(max(0, ages - len(arrived)), arrived[-1])])
    out_before = 1.0 - padded[:-1]
    hazards = np.divide(
        np.diff(padded), out_before, out=np.ones_like(out_before), where=out_before > 0.0
    )
    return hazards[:ages]


MOMENTS_MAX = 250_000
"""Largest size of all second moments together, for an analysis within a few seconds."""
MEANS_MS = (80, 160)
"""Mean latencies for which ``check`` finds the jitter that the loop tolerates."""
LOSS = 0.01
SPREAD_PARTS = 4
SPREAD_RESOLUTION_NS = 1_000_000
_SETTLING_S = 1.5
_STRIDE_S = 0.2
_ROUNDING = 1e-25
"""What a stride leaves of moments that are zero but for rounding."""
_SMALLEST_UNIT = 1e-9
_TOLERANCE = 1e-5
_SIGN_TOLERANCE = 0.3
_AGREEING = 4
_KRYLOV_VECTORS = 60
_INVARIANT = 1e-12
_SMALLEST = 1e-300


class JitterTooLargeError(ValueError):
    """The second moments are too many to be analysed."""


def stable_spreads(loop: SampledLoop, mean_ns: int, loss: float = 0.0) -> tuple[Interval, ...]:
    """Return the standard deviations from 0 to the mean at which the mean square decays, ascending.

    The latency has a gamma distribution. Tested every SPREAD_PARTS-th of the mean, boundaries
    bisected to SPREAD_RESOLUTION_NS; what begins and ends between two tests is missed. Jitter can
    help as well as harm: the commands that overtake make the loop's age smaller than the mean
    latency. Raises as ``MomentRecursion``.
    """

    def recursion(spread_ns: int) -> MomentRecursion:
        mean_s = mean_ns / NS_PER_S
        cdf = gamma_cdf(mean_s, spread_ns / NS_PER_S) if spread_ns else constant_cdf(mean_s)
        return MomentRecursion(loop, arrivals(cdf, loop.period_ns, loss))

    tested = [mean_ns * part // SPREAD_PARTS for part in range(SPREAD_PARTS + 1)]
    recursions = [recursion(spread_ns) for spread_ns in tested]  # all of them, before any is used
    judged = {
        spread_ns: each.is_stable() for spread_ns, each in zip(tested, recursions, strict=True)
    }
    return stable_intervals(
        judged, lambda spread_ns: recursion(spread_ns).is_stable(), SPREAD_RESOLUTION_NS
    )


class MomentRecursion:
    """X ↦ Σ_i P(i → j) A_j X_i A_jᵀ over one control period, as a linear operator.

    A mode is the age in periods of the command that is held, from the youngest that ever arrives to
    the oldest followed. The state is plant, law, and the commands of the ages 0 to the oldest.

    Raises JitterTooLargeError where commands on their way are too many, ValueError where none ever
    arrives.
    """

    def __init__(self, loop: SampledLoop, when: Arrivals) -> None:
        hazards = hazards_by_age(when)
        youngest = int(np.argmax(hazards > 0.0))
        law = without_idle_states(loop.law)
        a, b, c = companion_form(loop.model, len(law.d))
        plant_end, law_end = len(b), len(b) + len(law.b)
        order, modes = law_end + len(hazards), len(hazards) - youngest
        if modes * order**2 > MOMENTS_MAX:
            raise JitterTooLargeError(
                f"{modes} ages of the command held times {order}² moments are more than"
                f" {MOMENTS_MAX}: take a lower rate, a shorter latency or a smaller spread"
            )
        self._shape = (modes, order, order)
        self._period_s = loop.period_ns / NS_PER_S
        transition, hold = zero_order_hold(a, b, self._period_s)
        moves = np.broadcast_to(np.eye(order), self._shape).copy()
        moves[:, :plant_end, :plant_end] = transition
        moves[np.arange(modes), :plant_end, law_end + youngest + np.arange(modes)] = hold
        decides = np.eye(order)
        decides[law_end + 1 :] = decides[law_end:-1]  # all commands are a period older
        decides[plant_end : law_end + 1] = 0.0
        decides[plant_end : law_end + 1, :plant_end] = np.vstack([law.b, law.d]) @ c
        decides[plant_end : law_end + 1, plant_end:law_end] = np.vstack([law.a, law.c])
        self._step = decides @ moves
        self._chosen, self._kept = newest_arrivals(hazards[youngest:])

    def is_stable(self) -> bool:
        """Whether the moments decay; far from zero the rate need not be accurate for that."""
        return self.decay_1_s(_SIGN_TOLERANCE) > SLOWEST_DECAY_1_S

    def decay_1_s(self, relative_tolerance: float = 10.0 * _TOLERANCE) -> float:
        """Return -ln λ/(2T) of the largest eigenvalue λ, to 1 % where modes have equal rates.

        The map keeps moments positive semidefinite, so its spectral radius is an eigenvalue, and
        none has a larger real part. Arnoldi's method finds it. One of its steps is a stride of many
        periods, which separates the slow modes. It starts from, and is scaled by, what is left of
        any initial moments after _SETTLING_S: the modes of an observer are far from orthogonal, and
        otherwise the method would mistake a combination of fast ones for convergence.
        """
        periods = math.ceil(_STRIDE_S / self._period_s)
        x = np.broadcast_to(np.eye(self._shape[1]), self._shape).reshape(-1)
        for _ in range(math.ceil(_SETTLING_S / _STRIDE_S)):
            x = self._over(periods, x)
            largest = np.abs(x).max()
            if largest < _ROUNDING:
                return math.inf  # dead beat: nothing is left after a few periods
            x /= largest
        unit = np.sqrt(np.maximum(np.einsum("mii->i", x.reshape(self._shape)), 0.0))
        unit = np.maximum(unit, _SMALLEST_UNIT * unit.max())
        units = np.broadcast_to(np.outer(unit, unit), self._shape).reshape(-1)

        def stride(scaled: FloatArray) -> FloatArray:
            return np.asarray(self._over(periods, scaled * units) / units)

        rates = []
        for eigenvalue in _arnoldi(stride, x / units):
            rates.append(-0.5 * math.log(max(eigenvalue, _SMALLEST)) / (periods * self._period_s))
            last = rates[-_AGREEING:]
            if len(last) == _AGREEING and np.ptp(last) <= _TOLERANCE + relative_tolerance * abs(
                last[0]
            ):
                break
        return float(rates[-1])

    def _over(self, periods: int, moments: FloatArray) -> FloatArray:
        x, transposed = moments.reshape(self._shape).copy(), self._step.transpose(0, 2, 1)
        for _ in range(periods):
            _redistribute(x, self._chosen, self._kept)
            moved = self._step @ x @ transposed
            x[0], x[1:] = 0.0, moved[:-1]  # the command that is held is a period older
            x[-1] += moved[-1]  # but the oldest one stays in the oldest mode
        return x.reshape(-1)


def _arnoldi(operator: Callable[[FloatArray], FloatArray], start: FloatArray) -> Iterator[float]:
    """Return the largest real part of the Ritz values, for Krylov spaces of 1, 2, ... dimensions.

    Products over all moments are left to einsum: numpy would give them to several threads, which
    takes far longer where processors are shared.
    """
    basis = np.zeros((_KRYLOV_VECTORS + 1, len(start)))
    basis[0] = start / math.sqrt(float(np.einsum("i,i", start, start)))
    hessenberg = np.zeros((_KRYLOV_VECTORS + 1, _KRYLOV_VECTORS))
    for last in range(_KRYLOV_VECTORS):
        image = operator(basis[last])
        known = basis[: last + 1]
        for _ in range(2):  # the second time takes off what rounding left of the first
            shares = np.einsum("vi,i->v", known, image)
            image = image - np.einsum("vi,v->i", known, shares)
            hessenberg[: last + 1, last] += shares
        yield float(np.linalg.eigvals(hessenberg[: last + 1, : last + 1]).real.max())
        length = math.sqrt(float(np.einsum("i,i", image, image)))
        if length <= _INVARIANT * abs(hessenberg[last, last]):
            return
        hessenberg[last + 1, last] = length
        basis[last + 1] = image / length


def _redistribute(x: FloatArray, chosen: FloatArray, kept: FloatArray) -> None:
    """Let commands arrive: x_j becomes kept_j x_j + chosen_j Σ_{i > j} x_i."""
    behind, share = np.zeros_like(x[0]), np.empty_like(x[0])
    for place in range(len(x) - 1, -1, -1):
        np.multiply(chosen[place], behind, out=share)
        behind += x[place]
        x[place] *= kept[place]
        x[place] += share


def newest_arrivals(hazards: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return for each mode P(it is the youngest that arrives now) and P(none younger arrives now).

    i → j < i has the probability of the first of j, whatever i; i → i that of the second of i.
    """
    none_younger = np.concatenate([[1.0], np.cumprod(1.0 - hazards)])[:-1]
    return hazards * none_younger, none_younger
