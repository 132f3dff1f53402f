"""Stability of the sampled loop at any constant delay between controller and plant.

Controller and plant meet at the control ticks: the error is sampled, the law decides at once, its
command acts after the delay and is held until the next one acts. For that the loop is a linear
discrete system, exactly; limits, quantisation and jitter are left out. A latency of measurements
adds to the delay, rounded up to a whole number of periods.

The set of stable delays need not be an interval that starts at zero: an observer can make a loop
unstable at 80 ms and stable at 160 ms. Hence every delay is tested, not only the largest.
"""

import math
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from controller.analysis.linear_system import held_plant, law_system
from controller.design import LawDesign
from controller.transfer_function import TransferFunction
from runtime.node import NS_PER_S

SLOWEST_DECAY_1_S = 1e-3
"""A mode that decays more slowly is drift, not stability: a quarter of an hour to one third. It
also is what keeps rounding from deciding about a double pole at z = 1."""
MARGIN_RESOLUTION_NS = 10_000
_OMEGA_RAD_S_MIN = 1e-2
_OMEGAS = 20_000

Number = TypeVar("Number", np.float64, np.complex128)


class StabilityMargins(NamedTuple):
    """How far the loop, cut at the command on the wire, is from instability.

    ``gain_max``        factor above 1 that the loop gain must stay below; inf where there is none
    ``gain_min``        factor below 1 that it must stay above; 0 where there is none
    ``phase_rad``       distance from -1 where the loop gain is 1, the smallest [rad]; inf where the
                        gain never is 1
    ``crossover_rad_s``  where that is [rad/s]; NaN where the gain never is 1
    """

    gain_max: float
    gain_min: float
    phase_rad: float
    crossover_rad_s: float


class SampledLoop:
    """A law around a plant.

    ``design``     the law
    ``model``      the plant, from wheel angle [rad] to lateral error [m], strictly proper
    ``period_ns``  of the control ticks [ns]
    """

    def __init__(self, design: LawDesign, model: TransferFunction, period_ns: int) -> None:
        self._law = law_system(design)
        self._model = model
        self._period_ns = period_ns

    def closed_loop_poles(self, delay_ns: int) -> NDArray[np.complex128]:
        """Return all poles in z of the loop with a constant delay ≥ 0, largest modulus first."""
        poles = np.linalg.eigvals(self.closed_loop_matrix(delay_ns)).astype(np.complex128)
        return poles[np.argsort(-np.abs(poles), kind="stable")]

    def is_stable(self, delay_ns: int) -> bool:
        """Whether every mode of the loop decays."""
        return self.decay_1_s(delay_ns) > SLOWEST_DECAY_1_S

    def decay_1_s(self, delay_ns: int) -> float:
        """Return the decay rate of the slowest mode [1/s]; negative where it grows."""
        largest = float(np.abs(self.closed_loop_poles(delay_ns)[0]))
        return -math.log(largest) * NS_PER_S / self._period_ns

    def stable_delays(self, step_ns: int, delay_ns_max: int) -> tuple[int, ...]:
        """Return those of 0, step, 2 step, ... at which the loop is stable [ns]."""
        return tuple(
            delay_ns for delay_ns in range(0, delay_ns_max + 1, step_ns) if self.is_stable(delay_ns)
        )

    def delay_margin_ns(self, step_ns: int, delay_ns_max: int) -> int | None:
        """Return the delay at which stability is first lost, coming from zero [ns].

        The largest stable delay found, to MARGIN_RESOLUTION_NS. 0 if the loop is not even stable
        without delay, None if it is at every step up to the maximum. A loss of stability that is
        over within one step can be missed.
        """
        if not self.is_stable(0):
            return 0
        steps = range(step_ns, delay_ns_max + 1, step_ns)
        unstable_ns = next((step for step in steps if not self.is_stable(step)), None)
        if unstable_ns is None:
            return None
        stable_ns = unstable_ns - step_ns
        while unstable_ns - stable_ns > MARGIN_RESOLUTION_NS:
            middle_ns = (stable_ns + unstable_ns) // 2
            if self.is_stable(middle_ns):
                stable_ns = middle_ns
            else:
                unstable_ns = middle_ns
        return stable_ns

    def loop_response(
        self, omega_rad_s: NDArray[np.float64], delay_ns: int
    ) -> NDArray[np.complex128]:
        """Return the loop transfer at each ω above 0, up to Nyquist [rad/s].

        The loop is cut where the command goes onto the wire; -1 is the critical point.
        """
        z = np.exp(1j * omega_rad_s * self._period_ns / NS_PER_S)
        a, b_new, b_old, c, whole_periods = held_plant(self._model, self._period_ns, delay_ns)
        inputs = b_new + b_old / z[:, None]
        states = np.linalg.solve(z[:, None, None] * np.eye(len(c)) - a, inputs[:, :, None])
        plant = states[:, :, 0] @ c * z ** float(-whole_periods)
        return np.asarray(-self._law.response(z) * plant, dtype=np.complex128)

    def margins(self, delay_ns: int) -> StabilityMargins:
        """Return the classical margins at a constant delay, which mean little if unstable."""
        nyquist_rad_s = math.pi * NS_PER_S / self._period_ns
        omega_rad_s = np.geomspace(_OMEGA_RAD_S_MIN, nyquist_rad_s, _OMEGAS)
        loop = self.loop_response(omega_rad_s, delay_ns)
        on_axis = _at_sign_changes(loop.imag, loop.real)
        factors = -1.0 / on_axis[on_axis < 0.0]
        log_gain = np.log(np.abs(loop))
        phases_rad = np.abs(np.angle(-_at_sign_changes(log_gain, loop)))
        crossovers_rad_s = _at_sign_changes(log_gain, omega_rad_s)
        nearest = int(np.argmin(phases_rad)) if len(phases_rad) else None
        return StabilityMargins(
            gain_max=float(min(factors[factors > 1.0], default=math.inf)),
            gain_min=float(max(factors[factors < 1.0], default=0.0)),
            phase_rad=math.inf if nearest is None else float(phases_rad[nearest]),
            crossover_rad_s=math.nan if nearest is None else float(crossovers_rad_s[nearest]),
        )

    def closed_loop_matrix(self, delay_ns: int) -> NDArray[np.float64]:
        """Return the state matrix [z] of plant, law and the commands that are on their way.

        The commands are u[k-1], u[k-2], ..., u[k-n-1].
        """
        a, b_new, b_old, c, whole_periods = held_plant(self._model, self._period_ns, delay_ns)
        law = self._law
        plant_end = len(c)
        law_end = plant_end + len(law.b)
        order = law_end + whole_periods + 1
        command = np.zeros(order)  # u[k] from all states
        command[:plant_end] = law.d * c
        command[plant_end:law_end] = law.c
        on_its_way = np.eye(order)[law_end:]
        newer = on_its_way[whole_periods - 1] if whole_periods else command
        matrix = np.zeros((order, order))
        matrix[:plant_end] = np.outer(b_new, newer) + np.outer(b_old, on_its_way[whole_periods])
        matrix[:plant_end, :plant_end] += a
        matrix[plant_end:law_end, :plant_end] = np.outer(law.b, c)
        matrix[plant_end:law_end, plant_end:law_end] = law.a
        matrix[law_end] = command
        matrix[law_end + 1 :] = on_its_way[:-1]
        return matrix


def _at_sign_changes(judged: NDArray[np.float64], wanted: NDArray[Number]) -> NDArray[Number]:
    """Return ``wanted`` where ``judged``, sampled at the same points, crosses zero (linearly)."""
    before = np.flatnonzero(np.signbit(judged[:-1]) != np.signbit(judged[1:]))
    share = judged[before] / (judged[before] - judged[before + 1])
    return np.asarray(wanted[before] + share * (wanted[before + 1] - wanted[before]), wanted.dtype)
