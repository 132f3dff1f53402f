"""A loop of two rates at a constant latency, where it is linear; analysed as it runs.

The controller decides every control period on the newest measurement, which the plant takes every
sensor period. All of it repeats itself with the common multiple of both. At a constant latency the
echo shows a constant delay and every measurement arrives, so that the predictor, which looks back,
is linear too. The state at the beginning of a multiple is

    x = (vehicle and wheel, law and filter, commands sent, measurements in transit)

and its evolution is exact (``controller.analysis.loop_signals``). Limits, quantisation, jitter, and
the transients when echoes stop and return are neglected.

    stability          every mode of x ↦ A x in which command and error take part decays
    peak sensitivity   largest gain on the unit circle from what is added to the vehicle's commands
                       to the commands that act, G + F (zI - A)⁻¹ E: where the loop repeats itself
                       from tick to tick |1/(1 + L)|, else the largest singular value over all its
                       ticks, which is the same for a loop that does
    noise gain         RMS of the steer for white noise of 1 m on every lateral error and of
                       HEADING_NOISE_1_M times that on every heading error, P = A P Aᵀ + B Bᵀ
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...runtime.array_types import BoolArray, ComplexArray, FloatArray
from ...runtime.node import NS_PER_S
from ..history.echo_delay import LoopDelayParams
from ..laws.law_from_settings import LawDesign
from ..laws.predictor import NAME, PredictorSettings
from ..prediction.gains_over_speed import Y
from ..settings import ControllerSettings
from .loop_signals import LoopMatrices, LoopModel, Signals, Timing, continuous_model
from .sampled_loop import SLOWEST_DECAY_1_S
from .unit_responses import own_floats, unit_responses

_START_S = 10
"""Start of the analysed period, late enough for all the history that a law reads."""
_TICKS_MAX = 100
"""Most ticks, and most samples, in one common multiple of the periods."""
_FREQUENCIES = 600
_PARTS = 20
"""The frequencies are split into so many parts, so that the matrices of one fit into the cache."""
_OMEGA_RAD_S_MIN = 0.02


Responses = dict[tuple[Any, ...], FloatArray]
"""A law's known responses, by its speed and the timing of a tick."""


class PeriodicLoop:
    """A law around a vehicle that measures at a rate of its own.

    Both clocks start together, as in virtual time: a measurement taken at a tick is read by it.

    ``design``      the law, its parameters those of the vehicle's speed
    ``loop_delay``  periods of controller and sensors
    ``responses``   of the same law around other vehicles, extended by those computed here

    Raises ValueError where the two periods have no common multiple within 100 of either.
    """

    def __init__(
        self,
        design: LawDesign,
        loop_delay: LoopDelayParams,
        loop_model: LoopModel,
        responses: Responses | None = None,
    ) -> None:
        self.loop_model = loop_model
        self._design, self._loop_delay = design, loop_delay
        speed_m_s = loop_model.speed_m_s
        self._params = design.params if design.params_at is None else design.params_at(speed_m_s)
        sensors_ns = loop_delay.sensor_period_ns * max(loop_delay.yaw_rate_samples, 1)
        self.control_period_ns = loop_delay.period_ns
        self.period_ns = math.lcm(loop_delay.period_ns, sensors_ns)
        if self.period_ns > _TICKS_MAX * min(loop_delay.period_ns, loop_delay.sensor_period_ns):
            raise ValueError(
                f"control every {loop_delay.period_ns} ns and measurements every"
                f" {loop_delay.sensor_period_ns} ns have no common multiple within {_TICKS_MAX}"
                " periods: choose rate_hz and link.sensor_period_ms that have one"
            )
        self.looks_back = design.looking_back is not None
        self._commands_read = None if self.looks_back else max(design.commands_read or 0, 1)
        self._plant = continuous_model(loop_model)
        self._responses: Responses = {} if responses is None else responses
        self._last: tuple[int, LoopMatrices] | None = None

    def matrices(self, delay_ns: int) -> LoopMatrices:
        """Return the loop with a constant latency ≥ 0 of the commands."""
        if self._last is not None and self._last[0] == delay_ns:
            return self._last[1]
        timing = self._timing(delay_ns)
        law_floats = len(own_floats(self._design.initial_state(0.0)))
        has_wheel = self.loop_model.actuator_lag_s > 0.0
        signals = Signals(timing, self._plant, law_floats, has_wheel=has_wheel)
        for time_ns in timing.instants():
            signals.move_to(time_ns)
            if time_ns % self._loop_delay.sensor_period_ns == 0:
                signals.take_sample()
            if time_ns % self._loop_delay.period_ns == 0:
                signals.decide(self._respond)
        signals.move_to(timing.end_ns)
        self._last = delay_ns, signals.matrices()
        return self._last[1]

    def closed_loop_poles(self, delay_ns: int) -> ComplexArray:
        """Return the poles of the modes with command and error, largest modulus first.

        They are in z over one common multiple of the periods, usually the control period.
        """
        a, kept = self._kept(delay_ns)
        poles = np.linalg.eigvals(a[np.ix_(kept, kept)]).astype(np.complex128)
        return poles[np.argsort(-np.abs(poles), kind="stable")]

    def decay_1_s(self, delay_ns: int) -> float:
        """Return the decay rate of the slowest mode [1/s]; negative where it grows."""
        largest = float(np.abs(self.closed_loop_poles(delay_ns)[0]))
        return -math.log(largest) * NS_PER_S / self.period_ns

    def is_stable(self, delay_ns: int) -> bool:
        """Whether every mode decays."""
        return self.decay_1_s(delay_ns) > SLOWEST_DECAY_1_S

    def peak_sensitivity(self, delay_ns: int) -> float:
        """Return the largest gain from an addition to the commands to the acting commands."""
        loop, kept = self.matrices(delay_ns), self._kept(delay_ns)[1]
        # A command that began to act before is in the last state; no other state acts on it.
        kept = np.union1d(kept, [len(loop.a) - 1])
        a, e, f = loop.a[np.ix_(kept, kept)], loop.e[kept], loop.f[:, kept]
        nyquist_rad_s = math.pi * NS_PER_S / self.period_ns
        omega_rad_s = np.geomspace(_OMEGA_RAD_S_MIN, nyquist_rad_s, _FREQUENCIES)
        peak = 0.0
        points = np.array([np.exp(1j * each * self.period_ns / NS_PER_S) for each in omega_rad_s])
        for z in np.array_split(points, _PARTS):
            states = np.linalg.solve(z[:, None, None] * np.eye(len(kept)) - a, e)
            gains = np.linalg.norm(loop.g + f @ states, 2, axis=(1, 2))
            peak = max(peak, float(gains.max()))
        return peak

    def noise_gain_rad_m(self, delay_ns: int) -> float:
        """Return the RMS of the steer for white noise of 1 m; infinite where it grows."""
        if self.decay_1_s(delay_ns) <= 0.0:
            return math.inf
        from scipy.linalg import solve_discrete_lyapunov  # nodes import this module

        (a, b, c, d, *_), kept = self.matrices(delay_ns), self._kept(delay_ns)[1]
        a, b, c = a[np.ix_(kept, kept)], b[kept], c[:, kept]
        covariance = solve_discrete_lyapunov(a, b @ b.T)
        powers = np.einsum("ti,ij,tj->t", c, covariance, c) + np.square(d).sum(axis=1)
        return float(np.sqrt(powers.mean()))

    def _timing(self, delay_ns: int) -> Timing:
        both, first = self._loop_delay, -(-_START_S * NS_PER_S // self.period_ns)
        ticks, samples = self.period_ns // both.period_ns, self.period_ns // both.sensor_period_ns
        return Timing(
            *(both, delay_ns, self.loop_model.uplink_ns, first * ticks, first * samples),
            *(ticks, samples, self._commands_read),
        )

    def _kept(self, delay_ns: int) -> tuple[FloatArray, NDArray[np.intp]]:
        """Return A, and which states act on the lateral error and are acted on by it.

        The observers of a fallback do not act on the loop, and a fading difference decays alone.
        """
        a = self.matrices(delay_ns).a
        acts = a != 0.0
        return a, np.flatnonzero(_reached_from_error(acts) & _reached_from_error(acts.T))

    def _respond(self, timing: Timing, tick: int) -> FloatArray:
        """Return the response of a tick to law, commands and measurements; keep it."""
        ticks, samples = timing.rows_read_at(tick)
        speed_m_s = self.loop_model.speed_m_s
        key: tuple[Any, ...] = (speed_m_s, tick - timing.first_tick, ticks, samples)
        if timing.commands_read is None:
            applied = tuple(timing.applied_tick(sample) for sample in samples)
            key = (*key, timing.echoed_delay_ns(), applied)
        if key not in self._responses:
            self._responses[key] = unit_responses(
                self._design, self._params, timing, tick, speed_m_s
            )
        return self._responses[key]


def linear(settings: ControllerSettings) -> ControllerSettings:
    """Return the settings with lag and mass as set: measuring them is not linear."""
    table = getattr(settings, NAME)  # law packet has it too
    if not isinstance(table, PredictorSettings):
        return settings
    as_set = table.model_copy(update={"measures_lag": False, "measures_mass": False})
    return settings.model_copy(update={NAME: as_set})


def _reached_from_error(acts: BoolArray) -> BoolArray:
    """Return the lateral error and what it acts on; ``acts[i, j]``: j acts on i at once."""
    reached: BoolArray = np.arange(len(acts)) == Y
    while True:
        further = reached | (acts @ reached)
        if (further == reached).all():
            return reached
        reached = further
