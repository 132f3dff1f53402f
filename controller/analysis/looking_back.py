"""What travels round the loop of a law that looks back, as linear functions of where it began.

At a constant latency every instant is known before: when samples are taken, ticks run and commands
act, which of them the echo names, and what the controller has seen of it all. ``Signals`` moves the
vehicle exactly from event to event, in the order of ``tools.batch.loop``: commands that are due,
samples, the tick, and its command if there is no latency. ``unit_answers`` has what a tick makes of
it from the law's own step function, by unit vectors.
"""

from collections.abc import Callable, Iterator
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.design import LawDesign
from controller.held_input import held_over
from controller.law_interface import NO_VEHICLE, History, LawInput, Link
from controller.link import LinkParams
from controller.nominal_model import NominalVehicle
from runtime.node import NS_PER_S

Matrix = NDArray[np.float64]

BETA, R, PSI, Y, WHEEL = range(5)
_RING = 4096
_SETTLED_NS = 1_500_000_000
"""A law that waits for its filter to settle has it then."""


class Rig(NamedTuple):
    """What the law is to steer: a vehicle with an actuator, and its network.

    ``actuator_lag_s``  from the command to the wheel, first order; 0 for none [s]
    ``uplink_ns``       constant latency of every measurement and echo [ns]
    """

    vehicle: NominalVehicle
    actuator_lag_s: float = 0.0
    uplink_ns: int = 0


class Timing(NamedTuple):
    """When what happens, in the period that begins with ``first_tick`` and ``first_sample``."""

    link: LinkParams
    delay_ns: int
    uplink_ns: int
    first_tick: int
    first_sample: int
    ticks: int
    samples: int

    @property
    def end_ns(self) -> int:
        """When the next period begins [ns]."""
        return (self.first_tick + self.ticks) * self.link.period_ns

    def instants(self) -> list[int]:
        """Return when samples are taken and ticks run [ns]."""
        ticks = range(self.first_tick, self.first_tick + self.ticks)
        samples = range(self.first_sample, self.first_sample + self.samples)
        return sorted(
            {tick * self.link.period_ns for tick in ticks}
            | {sample * self.link.sensor_period_ns for sample in samples}
        )

    def newest_sample(self, tick: int) -> int:
        """Return the newest sample that has come at a tick."""
        return (tick * self.link.period_ns - self.uplink_ns) // self.link.sensor_period_ns

    def applied_tick(self, sample: int) -> int:
        """Return the tick whose command is in effect at a sample."""
        sample_ns = sample * self.link.sensor_period_ns
        if self.delay_ns == 0:  # the sample is taken before the tick
            return -(-sample_ns // self.link.period_ns) - 1
        return (sample_ns - self.delay_ns) // self.link.period_ns

    def echoed_delay_ns(self) -> float:
        """Return the delay that a long row of echoes shows."""
        samples = range(self.first_sample, self.first_sample + self.samples)
        offsets = [
            sample * self.link.sensor_period_ns - self.applied_tick(sample) * self.link.period_ns
            for sample in samples
        ]
        return sum(offsets) / len(offsets) - 0.5 * self.link.period_ns


class LoopMatrices(NamedTuple):
    """x ↦ A x + B w over one common multiple of the periods; steer of every tick = C x + D w.

    ``w``  noise of the lateral errors of its samples [m]
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix


class Signals:
    """Everything in the loop, each a row over the state at the beginning and the noise."""

    def __init__(
        self, timing: Timing, plant: tuple[Matrix, Matrix], law_floats: int, drive: float
    ) -> None:
        self._timing, self._drive = timing, drive
        self._a, self._b = plant
        self._now_ns = timing.first_tick * timing.link.period_ns
        self._tick, self._sample = timing.first_tick, timing.first_sample
        known = timing.newest_sample(self._tick - 1)
        ticks = range(timing.applied_tick(known), self._tick)
        samples = range(known, self._sample)
        vehicle = len(self._b)
        self._order = vehicle + law_floats + len(ticks) + 2 * len(samples)
        rows = iter(np.eye(self._order + timing.samples)[: self._order])
        self._vehicle = np.array([next(rows) for _ in range(vehicle)])
        self._law = np.array([next(rows) for _ in range(law_floats)])
        self._commands = {tick: next(rows) for tick in ticks}
        self._errors = {sample: (next(rows), next(rows)) for sample in samples}
        self._steers: list[Matrix] = []

    def move_to(self, time_ns: int) -> None:
        """Move the vehicle on, under each command that is in effect on the way."""
        delay_ns, period_ns = self._timing.delay_ns, self._timing.link.period_ns
        while self._now_ns < time_ns:
            tick = (self._now_ns - delay_ns) // period_ns
            until_ns = min(time_ns, (tick + 1) * period_ns + delay_ns)
            transition, input_gain = held_over(
                self._a, self._b, (until_ns - self._now_ns) / NS_PER_S
            )
            command = self._drive * self._commands[tick]
            self._vehicle = transition @ self._vehicle + np.outer(input_gain, command)
            self._now_ns = until_ns

    def take_sample(self) -> None:
        """Measure, with noise."""
        noise = np.zeros(self._vehicle.shape[1])
        noise[self._order + self._sample - self._timing.first_sample] = 1.0
        self._errors[self._sample] = (self._vehicle[Y] + noise, self._vehicle[PSI].copy())
        self._sample += 1

    def decide(self, answer: Callable[[Timing, int], Matrix]) -> None:
        """Let the law have its tick."""
        ticks, samples = told_at(self._timing, self._tick)
        told = [
            *self._law,
            *(self._commands[tick] for tick in ticks),
            *(row for sample in samples for row in self._errors[sample]),
        ]
        after = answer(self._timing, self._tick) @ np.array(told)
        self._law, steer = after[:-1], after[-1]
        self._commands[self._tick] = steer
        self._steers.append(steer)
        self._tick += 1

    def matrices(self) -> LoopMatrices:
        """Return the state at the end and the steers on the way, over state and noise."""
        known = self._timing.newest_sample(self._tick - 1)
        ticks = range(self._timing.applied_tick(known), self._tick)
        rows = [
            *self._vehicle,
            *self._law,
            *(self._commands[tick] for tick in ticks),
            *(row for sample in range(known, self._sample) for row in self._errors[sample]),
        ]
        end, steers = np.array(rows), np.array(self._steers)
        order = self._order
        return LoopMatrices(end[:, :order], end[:, order:], steers[:, :order], steers[:, order:])


def told_at(timing: Timing, tick: int) -> tuple[range, range]:
    """Return the commands and the samples that a law with a filter reads at a tick."""
    known = timing.newest_sample(tick - 1)
    return range(timing.applied_tick(known), tick), range(known, timing.newest_sample(tick) + 1)


def unit_answers(design: LawDesign, params: Any, timing: Timing, tick: int) -> Matrix:
    """Return law and steer after a tick, by what the law was before and is told."""
    wire = _Wire(timing)
    rest = _settled_at_rest(design, params, wire, tick)
    ticks, samples = told_at(timing, tick)
    floats = floats_in(rest)
    columns = []
    for unit in range(floats):
        state = _filled(rest, iter([1.0 if index == unit else 0.0 for index in range(floats)]))
        columns.append(design.step(params, state, wire.seen(tick)))
    numbers = [(wire.sent_rad, number) for number in ticks]
    for sample in samples:
        numbers += [(wire.lateral_error_m, sample), (wire.heading_error_rad, sample)]
    for ring, number in numbers:
        ring[number % _RING] = 1.0
        columns.append(design.step(params, rest, wire.seen(tick)))
        ring[number % _RING] = 0.0
    return np.array([[*_leaves(state), output.steer_rad] for state, output in columns]).T


def _settled_at_rest(design: LawDesign, params: Any, wire: "_Wire", tick: int) -> Any:
    """Return the state before a tick of a law that has seen nothing but zeros for long enough."""
    rest: Any = None
    for periods in (1, ceil(_SETTLED_NS / wire.period_ns)):
        rest = design.initial_state(0.0)
        for before in range(tick - periods, tick):
            rest, _ = design.step(params, rest, wire.seen(before))
        if all(_truths(rest)):  # it predicts, or takes its derivative from the filter
            break
    return rest


class _Wire:
    """What a law is told, all of it zero but for what is set in the rings."""

    def __init__(self, timing: Timing) -> None:
        self._timing, self._delay_ns = timing, timing.echoed_delay_ns()
        self.period_ns = timing.link.period_ns
        self.sent_rad = [0.0] * _RING
        self.lateral_error_m = [0.0] * _RING
        self.heading_error_rad = [0.0] * _RING
        applied = [-1] * _RING
        last = timing.first_sample + timing.samples
        for sample in range(max(0, last - _RING + 1), last + 1):
            applied[sample % _RING] = timing.applied_tick(sample)
        self._history = History(
            _RING - 1,
            _RING - 1,
            self.sent_rad,
            self.lateral_error_m,
            self.heading_error_rad,
            [True] * _RING,
            applied,
            [False] * _RING,
            [0.0] * _RING,
        )

    def seen(self, tick: int) -> LawInput:
        """Return what the law is told at a tick."""
        newest = self._timing.newest_sample(tick)
        return LawInput(
            self.lateral_error_m[newest % _RING],
            self.sent_rad[(tick - 1) % _RING],
            NO_VEHICLE,
            Link(tick, newest, newest, self._delay_ns, True),
            self._history,
        )


def continuous_rig(rig: Rig) -> tuple[Matrix, Matrix]:
    """Return vehicle and actuator, SAE 2018-01-1086 (1), from the command."""
    m, j, c_f, c_r, l_f, l_r, l_s, v = rig.vehicle
    a = np.zeros((5, 5))
    a[BETA, BETA] = -(c_r + c_f) / (m * v)
    a[BETA, R] = -1.0 + (c_r * l_r - c_f * l_f) / (m * v**2)
    a[R, BETA] = (c_r * l_r - c_f * l_f) / j
    a[R, R] = -(c_r * l_r**2 + c_f * l_f**2) / (j * v)
    a[PSI, R] = 1.0
    a[Y, BETA], a[Y, R], a[Y, PSI] = v, l_s, v
    a[BETA, WHEEL], a[R, WHEEL] = c_f / (m * v), c_f * l_f / j
    b = np.zeros(5)
    if rig.actuator_lag_s == 0.0:
        return a[:WHEEL, :WHEEL], a[:WHEEL, WHEEL]
    a[WHEEL, WHEEL], b[WHEEL] = -1.0 / rig.actuator_lag_s, 1.0 / rig.actuator_lag_s
    return a, b


def _leaves(nested: Any) -> Iterator[float]:
    """Return the floats of a law's state; whole numbers and truth values are not its own."""
    if isinstance(nested, tuple):
        for member in nested:
            yield from _leaves(member)
    elif isinstance(nested, float):
        yield nested


def _truths(nested: Any) -> Iterator[bool]:
    """Return the truth values of a law's state."""
    if isinstance(nested, tuple):
        for member in nested:
            yield from _truths(member)
    elif isinstance(nested, bool):
        yield nested


def floats_in(nested: Any) -> int:
    """Return how many floats a law's state holds."""
    return sum(1 for _ in _leaves(nested))


def _filled(form: Any, values: Iterator[float]) -> Any:
    """Return a state of the same types, its floats replaced."""
    if isinstance(form, tuple):
        members = [_filled(member, values) for member in form]
        return type(form)(*members) if hasattr(form, "_fields") else tuple(members)
    return next(values) if isinstance(form, float) else form
