"""How late this machine wakes a program up, and when a controller's work of the period is done.

The executor is the one that the programs use, waiting on the real port. Its node does what the
controller does in a period, with a measurement that it makes up and a command that it does not
send: a measurement must not disturb a bus in use.

A virtual machine that is stopped cannot be on time: how much time its host took is measured too.
"""

import math
import time
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from ...controller.node.node import ControllerNode
from ...controller.settings import ControllerSettings, controller_preset
from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import LateralError, encode
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from ...runtime.node.real_time_loop import Port, RealTimeExecutor
from ...runtime.node.statistics import DurationStatistics, DurationSummary
from ...runtime.program.priority_and_memory_lock import StealClock

AMPLITUDE_M, STEP_RAD = 0.01, 0.1


def measurements() -> list[Frame]:
    """Return measurements that can be sent in turn without end: one for each end-to-end counter.

    They oscillate, so that the law has work to do.
    """
    return [
        encode(LateralError(AMPLITUDE_M * math.sin(STEP_RAD * counter), 0.0), counter)
        for counter in range(COUNTERS)
    ]


PRESET = "practical_pd_ddob"
"""The law with the longest computing time."""


class Sample(NamedTuple):
    """One period: from its deadline to the wake-up, and to the end of its work [ns]."""

    lateness_ns: int
    done_ns: int


class Figures(NamedTuple):
    """Statistics of a number of periods; ``missed`` ones passed without a wake-up."""

    lateness: DurationSummary
    done: DurationSummary
    missed: int


class WakeUps(NamedTuple):
    """A measurement at one rate.

    ``steal_fraction``  of all processors' time, 0 to 1; None where the platform does not report it
    """

    rate_hz: int
    figures: Figures
    steal_fraction: float | None


class WorkingNode:
    """Does a controller's work in every period until ``end_ns``."""

    def __init__(
        self,
        settings: ControllerSettings,
        start_ns: int,
        end_ns: int,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._controller = ControllerNode(settings, start_ns)
        self._frames = measurements()
        self._end_ns = end_ns
        self._clock_ns = clock_ns
        self._ticks = 0
        self.samples: list[Sample] = []

    @property
    def deadline_ns(self) -> int:
        """When the next period begins [ns]."""
        return self._controller.deadline_ns

    @property
    def finished(self) -> bool:
        """Whether the time is up."""
        return self._controller.deadline_ns >= self._end_ns

    def on_frame(self, _frame: Frame, _now_ns: int) -> Sequence[Frame]:
        """Ignore the frame."""
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Work without sending."""
        deadline_ns = self._controller.deadline_ns
        self._controller.on_frame(self._frames[self._ticks % len(self._frames)], now_ns)
        self._controller.on_tick(now_ns)
        self._ticks += 1
        done_ns = self._clock_ns()
        self.samples.append(Sample(now_ns - deadline_ns, done_ns - deadline_ns))
        return ()


def measure_wake_ups(port: Port, rate_hz: int, seconds: float, spin_ns: int) -> WakeUps:
    """Work ``rate_hz`` times a second for ``seconds``; raises BusError."""
    settings = controller_preset(PRESET, [f"rate_hz={rate_hz}"])
    start_ns = time.monotonic_ns() + NS_PER_S // 10  # the design of the law takes milliseconds
    node = WorkingNode(settings, start_ns, start_ns + round(seconds * NS_PER_S))
    steal = StealClock()
    RealTimeExecutor(node, port, spin_ns=spin_ns).run(lambda: False)
    return WakeUps(rate_hz, figures_of(node.samples, settings.period_ns), steal.fraction())


def figures_of(samples: Sequence[Sample], period_ns: int) -> Figures:
    """Summarise periods."""
    return Figures(
        summary_of(sample.lateness_ns for sample in samples),
        summary_of(sample.done_ns for sample in samples),
        sum(sample.lateness_ns // period_ns for sample in samples),
    )


def summary_of(durations_ns: Iterable[int]) -> DurationSummary:
    """Summarise durations."""
    statistics = DurationStatistics()
    for duration_ns in durations_ns:
        statistics.record(duration_ns)
    return statistics.summary()
