"""What could explain both rows of Table II at once: readings tried, none of them adopted.

The text names neither the path nor the start of these runs. The loop is linear, so its error is a
sum of the answers to what may have excited it, each with a size of its own:

    reference   the path as r in C (r - y): a sine over distance, of any wavelength
    offset      y at the start
    heading     Δψ at the start
    curvature   of the inferred ellipse, as a disturbance

For each wavelength and duration of a grid the sizes are those that come closest to all eight
values, by the ratio of ours to theirs. Continuous time, the DOB with Q of (20) as published:

    u = C (r - y) - (Q/G_n) y + Q u
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import StateSpace, lsim, tf2ss

from ...closed_loop.parameter_space.uncertainty import paper_box
from ...controller.filters.nominal_model import NominalVehicle, paper_eq19
from ...plant_emulator.vehicle.single_track_model import VehicleParams, state_matrices
from ...runtime.array_types import FloatArray
from . import published
from .continuous_runs import K_D_RAD_S_M, K_P_RAD_M, PATH, Q_CUTOFF_RAD_S, curvature_met

REFERENCE, OFFSET, HEADING, CURVATURE = range(4)
READINGS = (
    ("offset and heading", (OFFSET, HEADING)),
    ("curvature, offset and heading", (CURVATURE, OFFSET, HEADING)),
    ("reference, offset and heading", (REFERENCE, OFFSET, HEADING)),
    ("reference, offset, heading and curvature", (REFERENCE, OFFSET, HEADING, CURVATURE)),
)
WAVELENGTHS_M = tuple(20.0 * 2.0 ** (0.5 * step) for step in range(10))
DURATIONS_S = (25.0, 50.0, 100.0, 200.0)
_SEED, _STARTS = 1, 3
"""Seeded guesses of the sizes from which each fit begins."""

_PUBLISHED_M = np.array([(c.pd_m, c.pd_dob_m) for c in published.TABLE_2]).T
"""Rows of PD and PD+DOB."""


class BothRows(NamedTuple):
    """The best of one reading: what it is, and its rows of PD and PD+DOB [m]."""

    label: str
    pd_m: tuple[float, ...]
    pd_dob_m: tuple[float, ...]

    @property
    def worst_share(self) -> float:
        """How far the worst of the eight is off, as a share of the published one."""
        ours_m = np.array([self.pd_m, self.pd_dob_m])
        return float(np.abs(ours_m / _PUBLISHED_M - 1.0).max())


def both_rows_attempts() -> Iterator[BothRows]:
    """Yield the best of each reading."""
    grams = {}
    for wavelength_m in WAVELENGTHS_M:
        answers = [
            error_answers(vehicle, with_dob=with_dob, wavelength_m=wavelength_m)
            for with_dob in (False, True)
            for vehicle in paper_box().vertices()
        ]
        for duration_s in DURATIONS_S:
            rows = round(duration_s / PATH.duration_s * (len(answers[0]) - 1)) + 1
            grams[wavelength_m, duration_s] = np.array(
                [a[:rows].T @ a[:rows] / rows for a in answers]
            )
    for label, kinds in READINGS:
        best_cost, best = np.inf, (np.zeros(8), "")
        for (wavelength_m, duration_s), gram in grams.items():
            cost, sizes, rms_m = _fitted(gram[:, kinds][:, :, kinds], _PUBLISHED_M.ravel())
            if cost < best_cost:
                best_cost, best = cost, (rms_m, _words(kinds, sizes, wavelength_m, duration_s))
        rms_m, words = best
        pd_m, pd_dob_m = rms_m.reshape(2, 4).tolist()
        yield BothRows(f"{label}: {words}", tuple(pd_m), tuple(pd_dob_m))


def error_answers(vehicle: NominalVehicle, *, with_dob: bool, wavelength_m: float) -> FloatArray:
    """Return the error every 50 ms for each excitation of size 1, shape (times, 4)."""
    a, b = state_matrices(VehicleParams(vehicle.speed_m_s, *vehicle[:-1]))
    time_s, curvature_1_m = curvature_met(vehicle.speed_m_s, PATH)
    omega_rad_s = 2.0 * np.pi * vehicle.speed_m_s / wavelength_m
    reference_m = np.sin(omega_rad_s * time_s)
    reference_m_s = omega_rad_s * np.cos(omega_rad_s * time_s)
    loop, order = _closed(a, b, with_dob=with_dob), len(a)
    at_rest, none = np.zeros(loop.A.shape[0]), np.zeros_like(time_s)
    beside, turned = at_rest.copy(), at_rest.copy()
    beside[order - 1], turned[order - 2] = 1.0, 1.0

    def answer(*inputs: FloatArray, start: FloatArray) -> FloatArray:
        _, y_m, _ = lsim(loop, np.stack(inputs, axis=1), time_s, X0=start)
        return np.asarray(y_m, dtype=np.float64)

    return np.stack(
        [
            answer(reference_m, reference_m_s, none, start=at_rest) - reference_m,
            answer(none, none, none, start=beside),
            answer(none, none, none, start=turned),
            answer(none, none, curvature_1_m, start=at_rest),
        ],
        axis=1,
    )


def _closed(a: FloatArray, b: FloatArray, *, with_dob: bool) -> StateSpace:
    """Return the loop from (r, dr/dt, ρ) to y; its state begins with the vehicle's."""
    y = np.array([0.0, 0.0, 0.0, 1.0])
    gains = -(K_P_RAD_M * y + K_D_RAD_S_M * a[3])
    parts = _observer() if with_dob else ()
    order = len(a) + sum(len(part_a) for part_a, *_ in parts)
    steer = np.zeros(order)  # u without r, from all states
    steer[:4] = gains
    start = 4
    for (part_a, _, part_c, part_d), sign in zip(parts, (1.0, -1.0), strict=False):
        end = start + len(part_a)
        steer[start:end] = sign * part_c[0]
        steer[:4] += sign * part_d[0, 0] * y
        start = end
    of_reference = np.array([K_P_RAD_M, K_D_RAD_S_M, 0.0])
    matrix, inputs = np.zeros((order, order)), np.zeros((order, 3))
    matrix[:4, :4] = a
    matrix[:4] += np.outer(b[:, 0], steer)
    inputs[:4] = np.outer(b[:, 0], of_reference)
    inputs[:4, 2] += b[:, 1]
    start = 4
    for (part_a, part_b, *_), is_fed_with_steer in zip(parts, (True, False), strict=False):
        own = slice(start, start + len(part_a))
        matrix[own, own] += part_a
        if is_fed_with_steer:
            matrix[own] += np.outer(part_b[:, 0], steer)
            inputs[own] += np.outer(part_b[:, 0], of_reference)
        else:
            matrix[own, :4] += np.outer(part_b[:, 0], y)
        start = own.stop
    output = np.zeros((1, order))
    output[0, 3] = 1.0
    return StateSpace(matrix, inputs, output, np.zeros((1, 3)))


def _observer() -> tuple[tuple[FloatArray, ...], ...]:
    """Return Q and Q/G_n of (11) as state spaces; Q of order 2 is strictly proper."""
    tau_s, model = 1.0 / Q_CUTOFF_RAD_S, paper_eq19()
    (zeros,), (poles,) = model.numerator, model.denominator
    q = [tau_s**2, 2.0 * tau_s, 1.0]
    inverse = tf2ss([*np.trim_zeros(poles, "f"), 0.0, 0.0], np.polymul(q, zeros))
    return tf2ss([1.0], q), inverse


def _fitted(gram: FloatArray, wanted_m: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Return the cost, the sizes and the eight RMS errors of the best fit."""
    random = np.random.default_rng(_SEED)

    def rms_m(sizes: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(np.einsum("i,kij,j->k", sizes, gram, sizes)))

    unit = 0.05 / np.sqrt(np.einsum("kii->i", gram) / len(gram))
    fits = [
        least_squares(lambda sizes: rms_m(sizes * unit) / wanted_m - 1.0, start)
        for start in random.normal(size=(_STARTS, gram.shape[1]))
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    sizes = np.asarray(best.x * unit)
    return float(best.cost), sizes, rms_m(sizes)


def _words(kinds: Sequence[int], sizes: FloatArray, wavelength_m: float, duration_s: float) -> str:
    text = {
        REFERENCE: f"sine of {{:.2f}} m over {wavelength_m:.0f} m",
        OFFSET: "{:.2f} m",
        HEADING: "{:.3f} rad",
        CURVATURE: "{:.2f} of the ellipse's",
    }
    sizes = sizes * np.sign(sizes[0])
    parts = [text[kind].format(size) for kind, size in zip(kinds, sizes, strict=True)]
    return ", ".join([*parts, f"{duration_s:g} s"])
