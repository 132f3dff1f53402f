"""Stability of the sampled loop at any constant delay between controller and plant.

At each control tick the error is sampled and the law computes its command without delay. The
command acts after the delay and is held until the next one acts. The loop is then exactly a linear
discrete system; limits, quantisation and jitter are neglected. A latency of measurements adds to
the delay, rounded up to a whole number of periods.

``stable_delays`` finds the delays at which the loop is stable; ``jitter`` treats varying delays.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...runtime.array_types import ComplexArray, FloatArray
from ...runtime.node import NS_PER_S
from ..filters.transfer_function import TransferFunction
from ..laws.law_from_settings import LawDesign
from .linear_system import (
    HeldPlant,
    held_plant,
    law_system,
    output_rows,
    plant_response,
    triangular,
)

SLOWEST_DECAY_1_S = 1e-3
"""A mode that decays more slowly counts as drift: it takes a quarter of an hour to fall to a third.
The bound also keeps rounding from deciding about a double pole at z = 1."""
_OMEGA_RAD_S_MIN = 1e-2
_GEOMETRIC_POINTS = 1500
_EVEN_POINTS_PER_PERIOD = 8  # a period of delay turns the loop by half a turn up to Nyquist
_EVEN_PERIODS = 20  # allowance for the phase of law and plant
_BISECTIONS = 40
_PEAK_ROUNDS = 4
_PEAK_POINTS = 21

RealFunction = Callable[[FloatArray], FloatArray]


class StabilityMargins(NamedTuple):
    """How far the loop, cut at the command on the bus, is from instability.

    ``gain_max``        factor above 1 that the loop gain must stay below; inf where there is none
    ``gain_min``        factor below 1 that it must stay above; 0 where there is none
    ``phase_rad``       distance from -1 where the loop gain is 1, the smallest [rad]; inf where the
                        gain never is 1
    ``crossover_rad_s``  where that is [rad/s]; NaN where the gain never is 1
    ``peak_sensitivity``  largest |1/(1 + L)|: the inverse of the smallest distance from -1
    ``peak_sensitivity_rad_s``  where that is [rad/s]
    """

    gain_max: float
    gain_min: float
    phase_rad: float
    crossover_rad_s: float
    peak_sensitivity: float
    peak_sensitivity_rad_s: float


class SampledLoop:
    """A law around a plant.

    ``model``      the plant, from wheel angle [rad] to lateral error [m], strictly proper

    Plant and period can be read back, the law as the matrices of its steps.
    """

    def __init__(self, design: LawDesign, model: TransferFunction, period_ns: int) -> None:
        self.law = law_system(design)
        self.model = model
        self.period_ns = period_ns

    def closed_loop_poles(self, delay_ns: int) -> ComplexArray:
        """Return all poles in z of the loop with a constant delay ≥ 0, largest modulus first."""
        poles = np.linalg.eigvals(self.closed_loop_matrix(delay_ns)).astype(np.complex128)
        return poles[np.argsort(-np.abs(poles), kind="stable")]

    def is_stable(self, delay_ns: int) -> bool:
        """Whether every mode of the loop decays."""
        return self.decay_1_s(delay_ns) > SLOWEST_DECAY_1_S

    def decay_1_s(self, delay_ns: int) -> float:
        """Return the decay rate of the slowest mode [1/s]; negative where it grows."""
        largest = float(np.abs(self.closed_loop_poles(delay_ns)[0]))
        return -math.log(largest) * NS_PER_S / self.period_ns

    def margins(self, delay_ns: int) -> StabilityMargins:
        """Return the classical margins at a constant delay, which mean little if unstable."""
        response, omega_rad_s = self.responder(delay_ns), self._grid(delay_ns)
        loop = response(omega_rad_s)
        real_at = _zeros(lambda omega: response(omega).imag, omega_rad_s, loop.imag)
        on_axis = np.append(response(real_at).real, loop[-1].real)  # z = -1 is always on the axis
        factors = -1.0 / on_axis[on_axis < 0.0]
        crossovers = _zeros(
            lambda omega: np.log(np.abs(response(omega))), omega_rad_s, np.log(np.abs(loop))
        )
        phases_rad = np.abs(np.angle(-response(crossovers)))
        nearest = int(np.argmin(phases_rad)) if len(phases_rad) else None
        peak, peak_rad_s = peak_of(lambda omega: 1.0 / np.abs(1.0 + response(omega)), omega_rad_s)
        return StabilityMargins(
            gain_max=float(min(factors[factors > 1.0], default=math.inf)),
            gain_min=float(max(factors[factors < 1.0], default=0.0)),
            phase_rad=math.inf if nearest is None else float(phases_rad[nearest]),
            crossover_rad_s=math.nan if nearest is None else float(crossovers[nearest]),
            peak_sensitivity=peak,
            peak_sensitivity_rad_s=peak_rad_s,
        )

    def responder(self, delay_ns: int) -> Callable[[FloatArray], ComplexArray]:
        """Return the loop transfer as a function of ω above 0, up to Nyquist [rad/s].

        The loop is cut where the command goes onto the bus; -1 is the critical point.
        """
        plant, law = self.plant(delay_ns), triangular(self.law)

        def response(omega_rad_s: FloatArray) -> ComplexArray:
            z = np.exp(1j * omega_rad_s * self.period_ns / NS_PER_S)
            outputs = plant_response(plant, output_rows(plant, z), z)
            return np.asarray(-(law.response(z) * outputs).sum(axis=0), dtype=np.complex128)

        return response

    def plant(self, delay_ns: int) -> HeldPlant:
        """Return the plant behind a constant delay, with the outputs that the law reads."""
        return held_plant(self.model, self.period_ns, delay_ns, len(self.law.d))

    def _grid(self, delay_ns: int) -> FloatArray:
        """Return ω up to Nyquist, dense in ratio and, for the turns of the delay, evenly."""
        nyquist_rad_s = math.pi * NS_PER_S / self.period_ns
        even = _EVEN_POINTS_PER_PERIOD * (delay_ns // self.period_ns + _EVEN_PERIODS)
        ratios = np.geomspace(_OMEGA_RAD_S_MIN, nyquist_rad_s, _GEOMETRIC_POINTS)
        return np.union1d(ratios[:-1], np.linspace(0.0, nyquist_rad_s, even + 1)[1:])

    def closed_loop_matrix(self, delay_ns: int) -> FloatArray:
        """Return the state matrix [z] of plant, law and the commands that are on their way.

        The commands are u[k-1], u[k-2], ..., u[k-n-1].
        """
        a, b_new, b_old, c, whole_periods = self.plant(delay_ns)
        law = self.law
        plant_end = len(a)
        law_end = plant_end + len(law.b)
        order = law_end + whole_periods + 1
        command = np.zeros(order)  # u[k] from all states
        command[:plant_end], command[plant_end:law_end] = law.d @ c, law.c
        on_its_way = np.eye(order)[law_end:]
        newer = on_its_way[whole_periods - 1] if whole_periods else command
        matrix = np.zeros((order, order))
        matrix[:plant_end] = np.outer(b_new, newer) + np.outer(b_old, on_its_way[whole_periods])
        matrix[:plant_end, :plant_end] += a
        matrix[plant_end:law_end, :plant_end] = law.b @ c
        matrix[plant_end:law_end, plant_end:law_end] = law.a
        matrix[law_end] = command
        matrix[law_end + 1 :] = on_its_way[:-1]
        return matrix


def _zeros(function: RealFunction, omega_rad_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return the zeros of a function between those neighbours of a grid where its sign changes."""
    before = np.flatnonzero(np.signbit(values[:-1]) != np.signbit(values[1:]))
    low, high = omega_rad_s[before], omega_rad_s[before + 1]
    negative_low = np.signbit(values[before])
    for _ in range(_BISECTIONS if len(before) else 0):
        middle = 0.5 * (low + high)
        is_low = np.signbit(function(middle)) == negative_low
        low, high = np.where(is_low, middle, low), np.where(is_low, high, middle)
    return np.asarray(0.5 * (low + high))


def peak_of(function: RealFunction, omega_rad_s: FloatArray) -> tuple[float, float]:
    """Return the largest value and where it is, on a grid that gets finer around it."""
    for _ in range(_PEAK_ROUNDS):
        values = function(omega_rad_s)
        at = int(np.argmax(values))
        peak, peak_rad_s = float(values[at]), float(omega_rad_s[at])
        low, high = omega_rad_s[max(0, at - 1)], omega_rad_s[min(at + 1, len(values) - 1)]
        omega_rad_s = np.linspace(low, high, _PEAK_POINTS)
    return peak, peak_rad_s
