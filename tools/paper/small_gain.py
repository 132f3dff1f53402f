"""Robust stability by the small gain theorem: SAE 2018-01-1086 (6) and (23) to (27).

    DOB     |Q(jω) Δ_m(jω)| < 1 for all ω,   Δ_m = (G e^(-sT) - G_n)/G_n               (23)

    CDOB    |L_n/(1 + L_n) Δ_m| < 1 for all ω,   Δ_m = e^(-jωT) - 1              (25), (27)
            L_n = C (1 - Q) G_n/(1 + C G_n Q),   so  L_n/(1 + L_n) = (1 - Q) C G_n/(1 + C G_n)

(17), (18) print e^(-T) for e^(-Ts), and (26) has a factor e^(-Ts) in L_n too many: with Δ_m the
delay, L_n (1 + Δ_m) is the loop, so L_n must not contain the delay a second time. ``as_printed``
takes it as printed nonetheless. The delay is exact, no Padé.

The conditions are sufficient and not necessary: they compare magnitudes and ignore phases. A loop
that meets one is stable, if it is stable for Δ_m = 0; a loop that fails it may be stable as well.
The exact answers are in ``continuous_loop`` and ``sampled_loop``.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ...closed_loop.parameter_space.root_count import on_axis
from ...controller.filters.transfer_function import TransferFunction
from ...runtime.array_types import ComplexArray, FloatArray

CUTOFF_RAD_S = (1e-2, 1e5)
"""Cutoffs are searched between these; a set that reaches the upper one counts as unbounded."""
_CUTOFFS = 250
_OMEGA_RAD_S = (1e-3, 1e5)
_OMEGAS = 10_000
_RELATIVE_RESOLUTION = 1e-7

QFamily = Callable[[float], TransferFunction]
"""Q of a cutoff ω_c [rad/s], always the same function of s/ω_c."""


class Interval(NamedTuple):
    """Cutoffs from one to the other [rad/s]; inf without an upper bound."""

    minimum_rad_s: float
    maximum_rad_s: float


class Peak(NamedTuple):
    """Largest magnitude of a response, and the ω where it is reached [rad/s]."""

    size: float
    omega_rad_s: float


class Uncertainty(NamedTuple):
    """Largest |Δ_m| over a set of plants at each ω [rad/s]; both arrays have the same length."""

    omega_rad_s: FloatArray
    size: FloatArray


class CdobParts(NamedTuple):
    """The transfer functions in (26)."""

    compensator: TransferFunction  # C [rad/m]
    q: TransferFunction  # Q, or H Q where there is a washout H
    model: TransferFunction  # G_n [m/rad]


def multiplicative_uncertainty(
    plant: TransferFunction, model: TransferFunction, omega_rad_s: FloatArray, delay_s: float = 0.0
) -> ComplexArray:
    """Return Δ_m of (6) at each ω above 0, for the plant behind a delay."""
    s = on_axis(omega_rad_s)
    ratio = plant.times(model.inverse()).response(s) * np.exp(-s * delay_s)
    return np.asarray(ratio - 1.0, np.complex128)


def largest_uncertainty(
    plants: Sequence[TransferFunction], model: TransferFunction, delay_s: float = 0.0
) -> Uncertainty:
    """Return the largest |Δ_m| of all plants, ω from 0.001 to 100,000 rad/s."""
    omega_rad_s = np.geomspace(*_OMEGA_RAD_S, _OMEGAS)
    sizes = [
        np.abs(multiplicative_uncertainty(plant, model, omega_rad_s, delay_s)) for plant in plants
    ]
    return Uncertainty(omega_rad_s, np.max(sizes, axis=0))


def condition_23(q: TransferFunction, uncertainty: Uncertainty) -> Peak:
    """Return the largest |Q Δ_m|: the condition is met where it is below 1."""
    omega_rad_s, size = uncertainty
    return _peak(np.abs(q.response(on_axis(omega_rad_s))) * size, omega_rad_s)


def cutoffs_that_meet_23(q_of_cutoff: QFamily, uncertainty: Uncertainty) -> tuple[Interval, ...]:
    """Return the cutoffs of a family of Q that meet (23), ascending.

    |Q| of (20) grows with ω_c at every ω, so there they are one range from 0; |Q| of type 2 has a
    hump above 1, and small cutoffs can fail where larger ones do not.
    """
    return accepted_cutoffs(
        lambda cutoff_rad_s: condition_23(q_of_cutoff(cutoff_rad_s), uncertainty).size < 1.0
    )


def accepted_cutoffs(
    accepts: Callable[[float], bool], points: int = _CUTOFFS
) -> tuple[Interval, ...]:
    """Return all ranges of cutoffs that a test accepts, their ends to 1 in 10 million.

    ``points`` cutoffs from 0.01 to 100,000 rad/s are tested, and each change between two neighbours
    is bisected; the verdict need not be monotone. A range narrower than a step, 7 % at 250 points,
    can be missed.
    """
    cutoffs_rad_s = [float(cutoff) for cutoff in np.geomspace(*CUTOFF_RAD_S, points)]
    verdicts = [accepts(cutoff) for cutoff in cutoffs_rad_s]
    edges = [
        _edge(accepts, cutoffs_rad_s[index], cutoffs_rad_s[index + 1], verdicts[index])
        for index in range(points - 1)
        if verdicts[index] != verdicts[index + 1]
    ]
    if verdicts[0]:
        edges.insert(0, 0.0)
    if verdicts[-1]:
        edges.append(math.inf)
    return tuple(Interval(*pair) for pair in zip(edges[::2], edges[1::2], strict=True))


def delay_uncertainty(omega_rad_s: FloatArray, delay_s: float) -> ComplexArray:
    """Return Δ_m = e^(-jωT) - 1 of (27), of size 2 |sin(ωT/2)|."""
    return np.asarray(np.expm1(-on_axis(omega_rad_s) * delay_s), np.complex128)


def cdob_nominal_loop(
    parts: CdobParts, omega_rad_s: FloatArray, printed_delay_s: float = 0.0
) -> ComplexArray:
    """Return L_n of (26) at each ω above 0.

    ``printed_delay_s``  T of the factor e^(-Ts) that (26) is printed with; 0: without it
    """
    s = on_axis(omega_rad_s)
    c_model = parts.compensator.times(parts.model).response(s)
    q = parts.q.response(s)
    nominal = c_model * (1.0 - q) / (1.0 + c_model * q)
    return np.asarray(nominal * np.exp(-s * printed_delay_s), np.complex128)


def cdob_small_gain(parts: CdobParts, delay_s: float, *, as_printed: bool = False) -> Peak:
    """Return the largest |L_n/(1 + L_n) Δ_m| of (25): the condition is met where it is below 1.

    ``as_printed`` takes (26) with its e^(-Ts). The condition then presupposes that the loop is
    stable at T, which was to be shown, and makes a statement about a delay of 2 T.
    """
    printed_delay_s = delay_s if as_printed else 0.0

    def size(omega_rad_s: FloatArray) -> FloatArray:
        nominal = cdob_nominal_loop(parts, omega_rad_s, printed_delay_s)
        return np.abs(nominal / (1.0 + nominal) * delay_uncertainty(omega_rad_s, delay_s))

    return _refined_peak(size)


def _refined_peak(size: Callable[[FloatArray], FloatArray]) -> Peak:
    """Return the maximum of a magnitude over ω, refined around the maximum on the grid."""
    omega_rad_s = np.geomspace(*_OMEGA_RAD_S, _OMEGAS)
    index = int(np.argmax(size(omega_rad_s)))
    around = omega_rad_s[max(0, index - 1)], omega_rad_s[min(_OMEGAS - 1, index + 1)]
    fine_rad_s = np.linspace(*around, 2001)
    return _peak(size(fine_rad_s), fine_rad_s)


def _peak(sizes: FloatArray, omega_rad_s: FloatArray) -> Peak:
    index = int(np.argmax(sizes))
    return Peak(float(sizes[index]), float(omega_rad_s[index]))


def _edge(accepts: Callable[[float], bool], low: float, high: float, verdict_low: bool) -> float:
    """Return where the verdict changes between two cutoffs [rad/s], on the accepted side."""
    while high - low > _RELATIVE_RESOLUTION * high:
        middle = 0.5 * (low + high)
        if accepts(middle) == verdict_low:
            low = middle
        else:
            high = middle
    return low if verdict_low else high
