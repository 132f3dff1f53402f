"""Sampled feedback loop: wheel, bus, road, and the round trips at which the wheel shakes.

Each cycle the wheel's angle is sampled and sent, the road wheel follows it, the road's torque is
sampled and sent back, and the motor holds it for a cycle. Between the samples everything is linear
and sampled exactly. The bus takes n whole cycles for both ways together; how they are shared
between the ways makes no difference.

    x[k+1] = F x[k] + g v[k]      w[k] = h x[k]      v[k] = w[k - n]

The number of unstable roots at n = 0 is counted by eigenvalues. With n a root crosses the unit
circle only at a frequency with |L| = 1, L(ω) = h (e^(jωT) I - F)⁻¹ g, and at n ω T = arg L(ω): it
leaves the circle where |L| falls with ω, and comes back where |L| rises. Counting these crossings
gives every range of unstable round trips, not only the first one.
"""

from collections.abc import Callable, Iterable, Iterator
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, schur

from ..wheel import LinearSystem, Matrix
from .sampled_laws import PASS_THROUGH, SampledLaw, zero_order_hold

_FREQUENCY_MIN_RAD_S = 1e-3
_FREQUENCIES = 4000
_BISECTIONS = 50


class UnstableRange(NamedTuple):
    """Round trips [s] at which the loop is unstable; ``end_s`` is None beyond the search.

    ``shakes_at_hz``  frequency with which the oscillation starts at the beginning of the range;
                      None where the loop is unstable without a delay
    """

    start_s: float
    end_s: float | None
    shakes_at_hz: float | None


class SampledFeedback(NamedTuple):
    """F, g and h as above; ``cycle_s`` is T."""

    f: Matrix
    g: Matrix
    h: Matrix
    cycle_s: float


def sampled_feedback(
    wheel: LinearSystem, road: LinearSystem, cycle_s: float, law: SampledLaw = PASS_THROUGH
) -> SampledFeedback:
    """Return the loop, cut where the bus is; no torque of the driver but by his grip."""
    (a, b, c), (a_road, b_road, c_road) = (zero_order_hold(part, cycle_s) for part in (wheel, road))
    of_angle, of_road, _ = law.b.T
    by_angle, by_road, _ = law.d
    f = block_diag(a + by_angle * np.outer(b, c), a_road, law.a)
    first, last = len(b), len(b) + len(b_road)
    f[first:last, :first] = np.outer(b_road, c)
    f[:first, last:], f[last:, :first] = np.outer(b, law.c), np.outer(of_angle, c)
    g = np.concatenate((by_road * b, np.zeros(len(b_road)), of_road))
    h = np.concatenate((np.zeros(first), c_road, np.zeros(len(law.c))))
    return SampledFeedback(f, g, h, cycle_s)


def unstable_round_trips(loop: SampledFeedback, up_to_s: float) -> tuple[UnstableRange, ...]:
    """Return every range of unstable round trips up to ``up_to_s``, exact at whole cycles."""
    closed = loop.f + np.outer(loop.g, loop.h)
    unstable = int(np.count_nonzero(np.abs(np.linalg.eigvals(closed)) > 1.0 + 1e-9))
    ranges = []
    start: tuple[float, float | None] | None = (0.0, None) if unstable else None
    for round_trip_s, change, omega_rad_s in sorted(_crossings(loop, up_to_s)):
        unstable += change
        if unstable and start is None:
            start = round_trip_s, omega_rad_s / (2.0 * pi)
        elif not unstable and start is not None:
            ranges.append(UnstableRange(start[0], round_trip_s, start[1]))
            start = None
    if start is not None:
        ranges.append(UnstableRange(start[0], None, start[1]))
    return tuple(ranges)


def is_unstable_at(ranges: Iterable[UnstableRange], round_trip_s: float) -> bool:
    """Whether a round trip is in one of the ranges."""
    return any(
        low <= round_trip_s and (high is None or round_trip_s < high) for low, high, _ in ranges
    )


def tolerated_jitter_s(loop: SampledFeedback, round_trip_s: float) -> float:
    """Return by how much the round trip may vary above a whole number of cycles, in any pattern.

    0 where the loop is unstable at that round trip itself. A sufficient bound, by small gain: with
    T = L z^-n/(1 - L z^-n), a delay between n and n + N cycles is stable if N |T (z - 1)| < 1 on
    the unit circle (C.-Y. Kao and B. Lincoln, Simple stability criteria for systems with
    time-varying delays, Automatica 40(8), 2004).
    """
    at_s = round(round_trip_s / loop.cycle_s) * loop.cycle_s
    if is_unstable_at(unstable_round_trips(loop, at_s), at_s):
        return 0.0
    omegas = _grid(loop)
    open_loop = _response_of(loop)(omegas) * np.exp(-1j * omegas * at_s)
    gains = np.abs(open_loop / (1.0 - open_loop) * (np.exp(1j * omegas * loop.cycle_s) - 1.0))
    return loop.cycle_s / float(gains.max())


def _crossings(loop: SampledFeedback, up_to_s: float) -> Iterator[tuple[float, int, float]]:
    """Yield round trip [s], change of the number of unstable roots, and frequency [rad/s]."""
    omegas, response = _grid(loop), _response_of(loop)
    gains = np.abs(response(omegas))
    for place in np.flatnonzero((gains[:-1] > 1.0) != (gains[1:] > 1.0)):
        low, high = omegas[place], omegas[place + 1]
        falls = gains[place] > 1.0
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            if (abs(response(np.array([middle]))[0]) > 1.0) == falls:
                low = middle
            else:
                high = middle
        angle = float(np.angle(response(np.array([low]))[0])) % (2.0 * pi)
        round_trip_s = angle / low
        while round_trip_s <= up_to_s:
            yield round_trip_s, 2 if falls else -2, float(low)
            round_trip_s += 2.0 * pi / low


def _grid(loop: SampledFeedback) -> Matrix:
    """Return frequencies up to half of the sampling's, with those near the poles [rad/s]."""
    poles = np.log(np.linalg.eigvals(loop.f).astype(complex) + 1e-300) / loop.cycle_s
    grid = np.geomspace(_FREQUENCY_MIN_RAD_S, pi / loop.cycle_s, _FREQUENCIES)
    near = np.abs(poles.imag)[:, np.newaxis] + np.abs(poles.real)[:, np.newaxis] * [-1, 0, 1]
    near = near[(near > grid[0]) & (near < grid[-1])]
    return np.unique(np.concatenate((grid, near)))


def _response_of(loop: SampledFeedback) -> Callable[[Matrix], NDArray[np.complex128]]:
    """Return L over frequencies [rad/s], by one Schur form of F for all of them."""
    triangle, basis = schur(loop.f, output="complex")
    g, h = basis.conj().T @ loop.g, loop.h @ basis

    def response(omegas_rad_s: Matrix) -> NDArray[np.complex128]:
        z = np.exp(1j * omegas_rad_s * loop.cycle_s)
        states = np.zeros((len(g), len(z)), np.complex128)
        for row in reversed(range(len(g))):
            below = triangle[row, row + 1 :] @ states[row + 1 :]
            states[row] = (g[row] + below) / (z - triangle[row, row])
        return np.asarray(h @ states, np.complex128)

    return response
