"""Figures of a run of the controller, for its report."""

from collections.abc import Mapping
from typing import Any

from ..dbc.messages import Mode
from ..runtime.node import NS_PER_S
from ..runtime.statistics import DurationStatistics, durations_report
from .control_sample import ControlSample


class RunFigures:
    """Collects the figures.

    ``start_ns``     when the first mode begins [ns]
    ``samples_max``  how many control periods are kept in ``samples``, oldest first

    ``peak_steer_rad``  the largest command sent, to either side [rad]
    ``last_tick_ns``    when the last control tick was [ns]
    """

    def __init__(self, start_ns: int, samples_max: int) -> None:
        self.last_tick_ns = start_ns
        self.round_trip = DurationStatistics()
        self.sample_age = DurationStatistics()
        self.samples: list[ControlSample] = []
        self._samples_max = samples_max
        self._mode_ns = dict.fromkeys(Mode, 0)
        self._mode, self._entered_ns = Mode.WAITING, start_ns
        self._holds = 0
        self.peak_steer_rad = 0.0

    def on_mode(self, entered: Mode) -> None:
        """Add the time up to this tick to the mode that ends with it."""
        self._mode_ns[self._mode] += self.last_tick_ns - self._entered_ns
        self._mode, self._entered_ns = entered, self.last_tick_ns
        self._holds += entered is Mode.HOLDING

    def on_command(self, steer_rad: float) -> None:
        """Record a sent command."""
        size_rad = abs(steer_rad)
        if size_rad > self.peak_steer_rad:
            self.peak_steer_rad = size_rad

    @property
    def wants_sample(self) -> bool:
        """Whether there is room for one more control period."""
        return len(self.samples) < self._samples_max

    def report(self) -> Mapping[str, Any]:
        """Return the figures, ready for JSON.

        ``holds``       how often measurements stopped, or the law failed
        ``mode_s``      time spent in each mode up to the last tick
        ``round_trip``  from sending a command to the first echo of its counter
        ``sample_age``  of the measurement in use, at each tick of the law
        """
        mode_ns = dict(self._mode_ns)
        mode_ns[self._mode] += self.last_tick_ns - self._entered_ns
        return {
            "holds": self._holds,
            "mode_s": {mode.name.lower(): ns / NS_PER_S for mode, ns in mode_ns.items()},
            "round_trip": durations_report(self.round_trip.summary()),
            "sample_age": durations_report(self.sample_age.summary()),
        }
