"""Figures of a run of the controller, and its verdict on its own work, for its report.

How the path was held is the plant's to judge.
"""

import math
from collections import Counter
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, NamedTuple

from ...dbc.messages import Mode, Validity
from ...runtime.node import NS_PER_S
from ...runtime.node.statistics import DurationStatistics
from ..law_interface import LawOutput


class ControlVerdict(StrEnum):
    """How a run of the controller ended."""

    NO_START = "no start"  # no measurement ever arrived
    FAULT = "fault"  # it has found a fault in itself
    SAFE_STOP = "safe stop"  # measurements have stopped
    HOLDING = "holding"  # measurements have just stopped
    NO_EFFECT = "no effect"  # the law steers, but the plant no longer follows its commands
    IN_CONTROL = "in control"  # the run ends with the law steering


EFFECT_NS = NS_PER_S
"""Without a new echo for longer, commands have no effect: however long the latency, the echo of an
older one comes with every measurement. A slow controller has EFFECT_PERIODS instead."""
EFFECT_PERIODS = 20
_OF_MODE: Mapping[Mode, ControlVerdict] = {
    Mode.WAITING: ControlVerdict.NO_START,
    Mode.ACTIVE: ControlVerdict.IN_CONTROL,
    Mode.HOLDING: ControlVerdict.HOLDING,
    Mode.SAFE_STOP: ControlVerdict.SAFE_STOP,
}
"""Verdict on a run that ends in a mode without a fault of its own."""


def control_verdict(failure: str, mode: Mode, silent_ns: int, period_ns: int) -> ControlVerdict:
    """Return the verdict on a run that ends in ``mode``, with a fault of its own or none.

    ``silent_ns``  time since the last command that took effect, or since the first measurement
    """
    if failure:
        return ControlVerdict.FAULT
    verdict = _OF_MODE[mode]
    is_silent = silent_ns > max(EFFECT_NS, EFFECT_PERIODS * period_ns)
    if verdict is ControlVerdict.IN_CONTROL and is_silent:
        return ControlVerdict.NO_EFFECT
    return verdict


class ControlSample(NamedTuple):
    """One control period with a command, for plots; the command is that after limits.

    ``sample_age_ns``  time since the newest measurement arrived [ns]
    ``law_output``     of this period; the last one while the mode is not ACTIVE
    """

    time_ns: int
    mode: Mode
    lateral_error_m: float
    sample_age_ns: int
    law_output: LawOutput
    sent_steer_rad: float


class RunFigures:
    """Collects the figures; up to ``samples_max`` control periods are kept in ``samples``."""

    def __init__(self, start_ns: int, period_ns: int, samples_max: int) -> None:
        self.last_tick_ns = self._effect_ns = start_ns
        self._period_ns = period_ns
        self.hears_effects = True
        """Whether the plant's messages on this bus echo commands."""
        self.round_trip = DurationStatistics()
        self.sample_age = DurationStatistics()
        self.samples: list[ControlSample] = []
        self.samples_left = samples_max
        self._mode_ns = dict.fromkeys(Mode, 0)
        self._mode, self._entered_ns = Mode.WAITING, start_ns
        self._holds = 0
        self._before_hold: tuple[Mode, dict[Mode, int], int] | None = None
        """Mode and times when the newest hold began, and when that was [ns]."""
        self.peak_steer_rad = 0.0
        self._law_ticks = 0
        self._squares_m2 = 0.0
        self._measured_peak_m = 0.0
        self._limited: Counter[str] = Counter()
        self.validity: Counter[Validity] = Counter()

    def on_mode(self, entered: Mode) -> None:
        """Add the time up to this tick to the mode that ends with it."""
        self._mode_ns[self._mode] += self.last_tick_ns - self._entered_ns
        if self._mode is Mode.WAITING:
            self._effect_ns = self.last_tick_ns
        if entered is Mode.HOLDING:
            self._holds += 1
            self._before_hold = self._mode, dict(self._mode_ns), self.last_tick_ns
        self._mode, self._entered_ns = entered, self.last_tick_ns

    def on_end_of_plant(self, silent_from_ns: int) -> None:
        """Leave out the hold that came of the plant's end, since its last message [ns]."""
        if self._before_hold is not None and self._before_hold[2] >= silent_from_ns:
            self._mode, self._mode_ns, self.last_tick_ns = self._before_hold
            self._entered_ns, self._holds = self.last_tick_ns, self._holds - 1
            self._before_hold = None

    def on_effect(self, round_trip_ns: int, now_ns: int) -> None:
        """Record the first echo of a command: it has taken effect."""
        self.round_trip.record(round_trip_ns)
        self._effect_ns = now_ns

    def on_law(self, measured_m: float, sent_rad: float, limit: str) -> None:
        """Record a tick of the law: its measurement, its command, and the limit that bound that.

        The other modes hold the law's commands or ramp them down, and never exceed their peak.
        """
        steer_rad, error_m = abs(sent_rad), abs(measured_m)
        if steer_rad > self.peak_steer_rad:
            self.peak_steer_rad = steer_rad
        self._law_ticks += 1
        self._squares_m2 += measured_m * measured_m
        if error_m > self._measured_peak_m:
            self._measured_peak_m = error_m
        if limit:
            self._limited[limit] += 1

    def keep(self, sample: ControlSample) -> None:
        """Store a control period in ``samples``."""
        self.samples.append(sample)
        self.samples_left -= 1

    def report(self, failure: str) -> Mapping[str, Any]:
        """Return the figures, ready for JSON.

        ``verdict``     what the controller knows of its own work (``ControlVerdict``)
        ``active_share``   of the time since the first measurement in which the law steered: its
                           ticks, each for one period
        ``in_effect``      commands that were seen to take effect, and ``no_effect_s``, the time
                           since the last of them; 0 on a bus without echoes
        ``measured_*``     of the lateral error that the law used
        ``limited_share``  of the law's commands that ``[limits]`` changed, and by which limit
        ``validity_share``  of the run's time in each state of VALIDITY
        ``holds``       how often measurements stopped, or the law failed
        ``mode_s``      time spent in each mode up to the last tick
        ``round_trip``  from sending a command to the first echo of its counter
        ``sample_age``  of the measurement in use, at each tick of the law
        """
        mode_ns = dict(self._mode_ns)
        mode_ns[self._mode] += self.last_tick_ns - self._entered_ns
        since_start_ns = sum(ns for mode, ns in mode_ns.items() if mode is not Mode.WAITING)
        ticks = max(self._law_ticks, 1)
        steered_ns = self._law_ticks * self._period_ns
        round_trip = self.round_trip.report()
        silent_ns = self.last_tick_ns - self._effect_ns if self.hears_effects else 0
        return {
            "verdict": str(control_verdict(failure, self._mode, silent_ns, self._period_ns)),
            "active_share": min(1.0, steered_ns / (since_start_ns + self._period_ns)),
            "in_effect": round_trip["samples"],
            "no_effect_s": max(0, silent_ns) / NS_PER_S,
            "measured_rms_m": math.sqrt(self._squares_m2 / ticks),
            "measured_peak_m": self._measured_peak_m,
            "limited_share": sum(self._limited.values()) / ticks,
            "limited_share_by": {name: n / ticks for name, n in self._limited.most_common()},
            "validity_share": {
                state.name.lower(): count / self.validity.total()
                for state, count in sorted(self.validity.items())
            },
            "holds": self._holds,
            "mode_s": {mode.name.lower(): ns / NS_PER_S for mode, ns in mode_ns.items()},
            "round_trip": round_trip,
            "sample_age": self.sample_age.report(),
        }
