"""The response of a law to unit inputs, at one tick.

The law's own step function is evaluated once for every float of its state and for every input that
it reads. This determines a law completely if it is linear at a constant latency.
"""

from math import ceil
from typing import Any

import numpy as np

from ...runtime.array_types import FloatArray
from ..history.history import RING_SIZE, empty_history
from ..law_interface import LawInput, LoopDelay, VehicleReading
from ..laws.law_from_settings import LawDesign
from .linear_system import filled, floats_of
from .loop_signals import Timing

_UNIT = 2.0**-20
"""A small unit, so that no limit is met; scaling by a power of two rounds nothing."""
_SETTLED_NS = 1_500_000_000
"""Time after which a law's filter has settled."""


def unit_responses(
    design: LawDesign, params: Any, timing: Timing, tick: int, speed_m_s: float
) -> FloatArray:
    """Return the law's state and steer after a tick, by its state before and its input.

    Counters of a law, which are not 0 at rest, are subtracted.
    """
    loop_input = _LoopInput(timing, speed_m_s)
    rest = _settled_at_rest(design, params, loop_input, timing, tick)
    ticks, samples = timing.rows_read_at(tick)
    at_rest = own_floats(rest)
    responses = [design.step(params, rest, loop_input.observed(tick))]
    for unit in range(len(at_rest)):
        moved = iter([*at_rest[:unit], at_rest[unit] + _UNIT, *at_rest[unit + 1 :]])
        responses.append(design.step(params, filled(rest, moved, float), loop_input.observed(tick)))
    numbers = [(loop_input.sent_rad, number) for number in ticks]
    for sample in samples:
        numbers += [(ring, sample) for ring in loop_input.measured]
    for ring, number in numbers:
        ring[number % RING_SIZE] = _UNIT
        responses.append(design.step(params, rest, loop_input.observed(tick)))
        ring[number % RING_SIZE] = 0.0
    rest_rows, *rows = [[*own_floats(state), output.steer_rad] for state, output in responses]
    columns: FloatArray = (np.array(rows) - np.array(rest_rows)) / _UNIT
    return columns.T


def _settled_at_rest(
    design: LawDesign, params: Any, loop_input: "_LoopInput", timing: Timing, tick: int
) -> Any:
    """Return the state before a tick of a law after zero input for long enough.

    The law starts with the first tick of a common multiple.
    """
    rest: Any = None
    for periods in (1, ceil(_SETTLED_NS / loop_input.period_ns)):
        rest = design.initial_state(0.0)
        first = (tick - periods) // timing.ticks * timing.ticks
        for before in range(first, tick):
            rest, _ = design.step(params, rest, loop_input.observed(before))
        if not any(value is False for value in floats_of(rest)):
            break  # it predicts
    return rest


class _LoopInput:
    """Input of a law, all zero except the values set in the rings."""

    def __init__(self, timing: Timing, speed_m_s: float) -> None:
        self._speed_m_s = speed_m_s
        self._timing, self._delay_ns = timing, timing.echoed_delay_ns()
        self.period_ns = timing.loop_delay.period_ns
        rings = self._history = empty_history(keeps_plans=False)
        self.sent_rad, self.lateral_error_m = rings.sent_rad, rings.lateral_error_m
        self.measured = [self.lateral_error_m, rings.heading_error_rad, rings.wheel_rad]
        every = timing.loop_delay.yaw_rate_samples
        if every:
            self.measured.append(rings.yaw_rate_rad_s)
        last = timing.first_sample + timing.samples
        for sample in range(max(0, last - RING_SIZE + 1), last + 1):
            rings.has_error[sample % RING_SIZE] = True
            has_yaw_rate = every > 0 and sample % every == 0
            rings.yaw_rate_sample[sample % RING_SIZE] = sample if has_yaw_rate else -1
            rings.applied_tick[sample % RING_SIZE] = timing.applied_tick(sample)

    def observed(self, tick: int) -> LawInput:
        """Return the law's input at a tick."""
        newest = self._timing.newest_sample(tick)
        return LawInput(
            self.lateral_error_m[newest % RING_SIZE],
            self.sent_rad[(tick - 1) % RING_SIZE],
            VehicleReading(self._speed_m_s, 0.0, 0.0),
            LoopDelay(tick, newest, newest, self._delay_ns, True, -1, newest),
            self._history,
        )


def own_floats(state: Any) -> list[float]:
    """Return the floats of a law's state; whole numbers and truth values are not its own."""
    return [value for value in floats_of(state) if isinstance(value, float)]
