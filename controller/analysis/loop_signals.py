"""The signals in a loop of two rates, as linear functions of the initial state.

At a constant latency every instant is known beforehand: when samples are taken, ticks run and
commands act, which command the echo names, and what the controller has received. ``Signals`` moves
the vehicle exactly from event to event, in the order of ``closed_loop.compiled.loop``: commands
that are due, samples, the tick, and its command if there is no latency.
``controller.analysis.unit_responses`` computes the response of a tick.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S
from ..filters.nominal_model import NominalVehicle
from ..filters.transfer_function import TransferFunction
from ..history.echo_delay import LoopDelayParams
from ..matrices import zero_order_hold
from ..prediction.gains_over_speed import BETA, DELTA, PSI, R, Y, continuous_vehicle
from .linear_system import companion_form

HEADING_NOISE_1_M = 0.1
"""Noise of the heading error over that of the lateral error: 2 mrad with 20 mm."""
YAW_RATE_NOISE_1_SM = 0.15
"""Noise of the yaw rate over that of the lateral error: 3 mrad/s with 20 mm."""


class LoopModel(NamedTuple):
    """The controlled system: a vehicle with an actuator, and its network.

    ``vehicle``         or G from wheel angle [rad] to lateral error [m], for a law that reads no
                        other signal; without actuator lag then
    ``actuator_lag_s``  from the command to the wheel, first order; 0 for none [s]
    ``uplink_ns``       constant latency of every measurement and echo [ns]
    """

    vehicle: NominalVehicle | TransferFunction
    actuator_lag_s: float = 0.0
    uplink_ns: int = 0

    @property
    def speed_m_s(self) -> float:
        """Speed of the vehicle; 0 if unknown [m/s]."""
        return 0.0 if isinstance(self.vehicle, TransferFunction) else self.vehicle.speed_m_s


class Timing(NamedTuple):
    """Times of all events in the period that begins with ``first_tick`` and ``first_sample``.

    ``commands_read``  how many of its last commands the law reads; None: all from the one that the
                       echo names, and the echo too
    """

    loop_delay: LoopDelayParams
    delay_ns: int
    uplink_ns: int
    first_tick: int
    first_sample: int
    ticks: int
    samples: int
    commands_read: int | None = None

    @property
    def end_ns(self) -> int:
        """When the next period begins [ns]."""
        return (self.first_tick + self.ticks) * self.loop_delay.period_ns

    def instants(self) -> list[int]:
        """Return when samples are taken and ticks run [ns]."""
        ticks = range(self.first_tick, self.first_tick + self.ticks)
        samples = range(self.first_sample, self.first_sample + self.samples)
        return sorted(
            {tick * self.loop_delay.period_ns for tick in ticks}
            | {sample * self.loop_delay.sensor_period_ns for sample in samples}
        )

    @property
    def wheel_ns(self) -> int:
        """Latency of the commands, and the dead time of the steering [ns]."""
        return self.delay_ns + self.loop_delay.dead_samples * self.loop_delay.sensor_period_ns

    def newest_sample(self, tick: int) -> int:
        """Return the newest sample that has arrived by a tick."""
        sent_ns = tick * self.loop_delay.period_ns - self.uplink_ns
        return sent_ns // self.loop_delay.sensor_period_ns

    def applied_tick(self, sample: int) -> int:
        """Return the tick whose command is in effect at a sample."""
        sample_ns = sample * self.loop_delay.sensor_period_ns
        if self.delay_ns == 0:  # the sample is taken before the tick
            return -(-sample_ns // self.loop_delay.period_ns) - 1
        return (sample_ns - self.delay_ns) // self.loop_delay.period_ns

    def rows_read_at(self, tick: int) -> tuple[range, range]:
        """Return the commands and the samples that a law may read at a tick."""
        known = self.newest_sample(tick - 1)
        samples = range(known, self.newest_sample(tick) + 1)
        if self.commands_read is not None:
            return range(tick - self.commands_read, tick), samples
        return range(self.applied_tick(known - self.loop_delay.dead_samples), tick), samples

    def commands_kept(self, tick: int) -> range:
        """Return the commands before a tick that law or plant still use."""
        applied = self.applied_tick(self.newest_sample(tick - 1) - self.loop_delay.dead_samples)
        return range(min(applied, tick - (self.commands_read or 1)), tick)

    def acting_tick(self, time_ns: int) -> int:
        """Return the tick whose command acts from a time on."""
        return (time_ns - self.wheel_ns) // self.loop_delay.period_ns

    def echoed_delay_ns(self) -> float:
        """Return the mean delay measured by many echoes."""
        samples = range(self.first_sample, self.first_sample + self.samples)
        offsets = [
            sample * self.loop_delay.sensor_period_ns
            - self.applied_tick(sample) * self.loop_delay.period_ns
            for sample in samples
        ]
        return sum(offsets) / len(offsets) - 0.5 * self.loop_delay.period_ns


class LoopMatrices(NamedTuple):
    """x ↦ A x + B w over one common multiple of the periods; steer of every tick = C x + D w.

    And x ↦ A x + E v with p = F x + G v: v is added to the commands that begin to act, and p acts
    then. x contains the last command that began to act before and still acts.

    ``w``  noise of the lateral errors of its samples [m], and of the heading errors and the yaw
           rates that the law reads, relative to HEADING_NOISE_1_M and YAW_RATE_NOISE_1_SM
    ``v``  added after the law, which does not know of it [rad]
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray
    e: FloatArray
    f: FloatArray
    g: FloatArray


class Signals:
    """All signals in the loop, each a row over the initial state, the noise and v.

    ``plant``      ``continuous_model``
    ``has_wheel``  whether its last state is the wheel, behind a lag
    """

    def __init__(
        self,
        timing: Timing,
        plant: tuple[FloatArray, FloatArray],
        law_floats: int,
        *,
        has_wheel: bool,
    ) -> None:
        self._timing, self._has_wheel = timing, has_wheel
        self._a, self._b = plant
        self._now_ns = timing.first_tick * timing.loop_delay.period_ns
        self._tick, self._sample = timing.first_tick, timing.first_sample
        known = timing.newest_sample(self._tick - 1)
        ticks = timing.commands_kept(self._tick)
        samples = range(known, self._sample)
        acting = timing.acting_tick(self._now_ns)
        vehicle, held = len(self._b), (timing.wheel_ns % timing.loop_delay.period_ns > 0)
        self._signals = 4 if timing.loop_delay.yaw_rate_samples else 3
        self._order = vehicle + law_floats + len(ticks) + self._signals * len(samples) + held
        self._noisy = self._order + (self._signals - 1) * timing.samples
        columns = np.eye(self._noisy + timing.ticks)
        rows, added = iter(columns[: self._order]), columns[self._noisy :]
        self._vehicle = np.array([next(rows) for _ in range(vehicle)])
        self._law = np.array([next(rows) for _ in range(law_floats)])
        self._commands = {tick: next(rows) for tick in ticks}
        self._measured = {sample: [next(rows) for _ in range(self._signals)] for sample in samples}
        self._added = {acting: next(rows)} if held else {}
        self._begins = range(acting + held, acting + held + timing.ticks)
        self._added |= dict(zip(self._begins, added, strict=True))
        self._steers: list[FloatArray] = []
        self._acts: dict[int, FloatArray] = {}

    def move_to(self, time_ns: int) -> None:
        """Move the vehicle on, under each command that is in effect on the way."""
        wheel_ns, period_ns = self._timing.wheel_ns, self._timing.loop_delay.period_ns
        while self._now_ns < time_ns:
            tick = self._timing.acting_tick(self._now_ns)
            until_ns = min(time_ns, (tick + 1) * period_ns + wheel_ns)
            transition, input_gain = zero_order_hold(
                self._a, self._b, (until_ns - self._now_ns) / NS_PER_S
            )
            self._acts[tick] = self._commands[tick] + self._added[tick]
            self._vehicle = transition @ self._vehicle + np.outer(input_gain, self._acts[tick])
            self._now_ns = until_ns

    def take_sample(self) -> None:
        """Measure both errors and the yaw rate, with noise, and the wheel.

        Without a lag, that is the command.
        """
        lateral, heading, yaw_rate = (self._vehicle[state].copy() for state in (Y, PSI, R))
        place = self._order + (self._signals - 1) * (self._sample - self._timing.first_sample)
        lateral[place], heading[place + 1] = 1.0, HEADING_NOISE_1_M
        acting = self._timing.applied_tick(self._sample - self._timing.loop_delay.dead_samples)
        wheel = self._commands[acting] + self._added.get(acting, 0.0)
        if self._has_wheel:
            wheel = self._vehicle[-1].copy()
        self._measured[self._sample] = [lateral, heading, wheel]
        if self._signals > 3:
            yaw_rate[place + 2] = YAW_RATE_NOISE_1_SM
            self._measured[self._sample].append(yaw_rate)
        self._sample += 1

    def decide(self, respond: Callable[[Timing, int], FloatArray]) -> None:
        """Run the law's tick."""
        ticks, samples = self._timing.rows_read_at(self._tick)
        rows = [
            *self._law,
            *(self._commands[tick] for tick in ticks),
            *(row for sample in samples for row in self._measured[sample]),
        ]
        after = respond(self._timing, self._tick) @ np.array(rows)
        self._law, steer = after[:-1], after[-1]
        self._commands[self._tick] = steer
        self._steers.append(steer)
        self._tick += 1

    def matrices(self) -> LoopMatrices:
        """Return the final state, and the steers and acting commands in between."""
        known = self._timing.newest_sample(self._tick - 1)
        ticks = self._timing.commands_kept(self._tick)
        acting = self._timing.acting_tick(self._now_ns)
        rows = [
            *self._vehicle,
            *self._law,
            *(self._commands[tick] for tick in ticks),
            *(row for sample in range(known, self._sample) for row in self._measured[sample]),
            *([self._added[acting]] if acting in self._added else []),
        ]
        end, steers = np.array(rows), np.array(self._steers)
        acts = np.array([self._acts[tick] for tick in self._begins])
        order, noisy = self._order, self._noisy
        return LoopMatrices(
            end[:, :order],
            end[:, order:noisy],
            steers[:, :order],
            steers[:, order:noisy],
            end[:, noisy:],
            acts[:, :order],
            acts[:, noisy:],
        )


def continuous_model(loop_model: LoopModel) -> tuple[FloatArray, FloatArray]:
    """Return vehicle and actuator, SAE 2018-01-1086 (1), from the command."""
    if isinstance(loop_model.vehicle, TransferFunction):
        return _observer_form(loop_model.vehicle)
    vehicle, lag_s = loop_model.vehicle, loop_model.actuator_lag_s
    a, b = continuous_vehicle(vehicle, lag_s)
    states = [BETA, R, PSI, Y, *([DELTA] if lag_s else [])]
    return a[np.ix_(states, states)], b[states]


def _observer_form(model: TransferFunction) -> tuple[FloatArray, FloatArray]:
    """Return A and b of a transfer function whose output is the state of the lateral error.

    A model of fewer states leaves some that nothing drives.
    """
    a, b, (c,) = companion_form(model)
    order = max(len(b), Y + 1)
    padded_a, padded_b = np.zeros((order, order)), np.zeros(order)
    padded_a[: len(b), : len(b)], padded_b[: len(b)] = a.T, c
    at = np.arange(order)
    at[[Y, len(b) - 1]] = at[[len(b) - 1, Y]]
    return padded_a[np.ix_(at, at)], padded_b[at]
