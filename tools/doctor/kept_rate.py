"""The control rate that this machine keeps, measured with the work of a controller.

The executor is the programs' own. Its node does in each period what the controller does, with a
measurement that it makes up and a command that it does not send. A virtual machine that is stopped
cannot be on time: how much time its host took is measured too.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table

from ...controller.node.node import ControllerNode
from ...controller.settings import ControllerSettings, controller_preset
from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import LateralError, encode
from ...runtime.command_line import say
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_MS, NS_PER_S, NS_PER_US
from ...runtime.node.real_time_loop import RealTimeExecutor
from ...runtime.node.statistics import DurationStatistics, DurationSummary, durations_report
from ...runtime.program.priority_and_memory_lock import (
    HostAnswer,
    RealTimeRequest,
    StealClock,
    real_time,
)

RATES_HZ = (100, 500, 1000)
PRESET = "practical_pd_ddob"
"""The law with the longest computing time."""
ORDINARY, REAL_TIME = "ordinary", "real-time"
RIGHTS = ("real-time priority", "memory lock")
"""The host's rights that an ordinary user is refused."""
LATENESS_SHARE_MAX = 0.1
"""Share of the period, for 99 of 100 wake-ups: beyond it, the law's samples are no longer equally
spaced."""
DONE_SHARE_MAX = 0.5
"""Share of the period, for 99 of 100 ticks: the other half is for frames, and a reserve."""
MISSED_SHARE_MAX = 0.001
"""Share of all periods: any machine stalls at times, and a controller continues on its grid."""
RULE = (
    "a rate is kept if at most one period in a thousand is missed, 99 of 100 wake-ups are late by "
    "at most a tenth of the period, and 99 of 100 ticks are done within half of it"
)
_WIDTH_MIN = 95
"""Width of the table, whose figures are no use cut short."""


class Periods(NamedTuple):
    """What was measured at one rate.

    ``lateness``        from the deadline of a period to its wake-up
    ``done``            from the deadline to the end of the period's work
    ``missed``          periods without a wake-up
    ``steal_fraction``  of all processors' time, 0 to 1; None where the platform does not report it
    """

    rate_hz: int
    lateness: DurationSummary
    done: DurationSummary
    missed: int
    steal_fraction: float | None

    @property
    def is_kept(self) -> bool:
        """Whether the machine keeps this rate."""
        period_ns, served = NS_PER_S / self.rate_hz, self.lateness.samples
        return (
            served > 0
            and self.missed <= MISSED_SHARE_MAX * (served + self.missed)
            and self.lateness.p99_ns <= LATENESS_SHARE_MAX * period_ns
            and self.done.p99_ns <= DONE_SHARE_MAX * period_ns
        )


class Measured(NamedTuple):
    """What was measured with one set of rights."""

    rights: str
    answers: list[HostAnswer]
    rates: list[Periods]


class IdleBus:
    """A bus on which no frame arrives, so that the executor only waits."""

    def recv(self, timeout_s: float) -> None:
        """Wait."""
        time.sleep(timeout_s)

    def send(self, _frame: Frame) -> bool:
        """Accept a frame."""
        return True


class WorkingNode:
    """A node that does a controller's work in every period until ``end_ns``."""

    def __init__(
        self,
        settings: ControllerSettings,
        start_ns: int,
        end_ns: int,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._controller = ControllerNode(settings, start_ns)
        self._period_ns = settings.period_ns
        self._frames = [
            encode(
                LateralError(lateral_error_m=0.01 * math.sin(0.1 * counter), heading_error_rad=0.0),
                counter,
            )
            for counter in range(COUNTERS)
        ]
        self._end_ns, self._clock_ns = end_ns, clock_ns
        self._ticks = 0
        self.lateness, self.done = DurationStatistics(), DurationStatistics()
        self.missed = 0

    @property
    def deadline_ns(self) -> int:
        """When the next period begins [ns]."""
        return self._controller.deadline_ns

    @property
    def finished(self) -> bool:
        """Whether the time is up."""
        return self.deadline_ns >= self._end_ns

    def on_frame(self, _frame: Frame, _now_ns: int) -> Sequence[Frame]:
        """Ignore the frame."""
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Work without sending."""
        deadline_ns = self.deadline_ns
        self._controller.on_frame(self._frames[self._ticks % COUNTERS], now_ns)
        self._controller.on_tick(now_ns)
        self._ticks += 1
        self.lateness.record(now_ns - deadline_ns)
        self.done.record(self._clock_ns() - deadline_ns)
        self.missed += (now_ns - deadline_ns) // self._period_ns
        return ()


def measure(options: argparse.Namespace, name: str) -> tuple[list[Measured], str]:
    """Return what was measured, and why nothing was measured with real-time rights, if so."""
    ordinary = RealTimeRequest(cpu=options.cpu)
    measured = [_measure(ORDINARY, ordinary, options, name)]
    if not options.priority and not options.lock_memory:
        return measured, "not asked for"
    request = RealTimeRequest(options.priority, options.cpu, options.lock_memory)
    with real_time(request) as answers:
        rights = [answer for answer in answers if answer.name in RIGHTS]
    if any(answer.got for answer in rights):
        return [*measured, _measure(REAL_TIME, request, options, name)], ""
    return measured, ", ".join(f"{answer.name} ({answer.detail})" for answer in rights)


def _measure(
    rights: str, request: RealTimeRequest, options: argparse.Namespace, name: str
) -> Measured:
    rates = []
    with real_time(request) as answers:
        for rate_hz in RATES_HZ:
            say(name, f"wake-ups at {rate_hz} Hz, {rights}", sys.stderr)
            rates.append(_periods(rate_hz, options.duration, options.spin_us * NS_PER_US))
    return Measured(rights, list(answers), rates)


def _periods(rate_hz: int, seconds: float, spin_ns: int) -> Periods:
    settings = controller_preset(PRESET, [f"rate_hz={rate_hz}"])
    start_ns = time.monotonic_ns() + NS_PER_S // 10  # the design of the law takes milliseconds
    node = WorkingNode(settings, start_ns, start_ns + round(seconds * NS_PER_S))
    steal = StealClock()
    RealTimeExecutor(node, IdleBus(), spin_ns=spin_ns).run(lambda: False)
    figures = node.lateness.summary(), node.done.summary(), node.missed
    return Periods(rate_hz, *figures, steal.fraction())


def rate_kept_hz(rates: Sequence[Periods]) -> int | None:
    """Return the highest rate that is kept together with all lower ones; None without any."""
    kept = None
    for periods in sorted(rates, key=lambda each: each.rate_hz):
        if not periods.is_kept:
            break
        kept = periods.rate_hz
    return kept


def show(measured: Sequence[Measured], refused: str) -> None:
    """Print a table in milliseconds, and what it means; the verdict is last."""
    console = Console(markup=False, highlight=False)
    console.width = max(console.width, _WIDTH_MIN)
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("times in ms", no_wrap=True)
    for heading in ("samples", "p50", "p99", "max", "done p99", "missed", "stolen"):
        table.add_column(heading, justify="right", no_wrap=True, min_width=len(heading))
    table.add_column("kept", no_wrap=True)
    for each in measured:
        for one in each.rates:
            late, steal = one.lateness, one.steal_fraction
            times_ns = (late.p50_ns, late.p99_ns, late.max_ns, one.done.p99_ns)
            table.add_row(
                f"wake-up, {one.rate_hz} Hz, {each.rights}",
                str(late.samples),
                *(f"{time_ns / NS_PER_MS:.3f}" for time_ns in times_ns),
                str(one.missed),
                "unknown" if steal is None else f"{100 * steal:.1f} %",
                "yes" if one.is_kept else "no",
            )
        table.add_section()
    console.print(table)
    for sentence in sentences(measured, refused):
        console.print(sentence, soft_wrap=True)


def sentences(measured: Sequence[Measured], refused: str) -> Iterator[str]:
    """Yield the host's answers, the rule, and a verdict for each set of rights."""
    if refused:
        yield f"no measurement with real-time rights: {refused}"
    for answer in measured[-1].answers:
        yield f"{answer.name}: {'' if answer.got else 'refused, '}{answer.detail}"
    yield f"rule: {RULE}"
    for each in measured:
        kept_hz = rate_kept_hz(each.rates)
        keeps = (
            f"not even {min(RATES_HZ)} Hz" if kept_hz is None else f"a controller at {kept_hz} Hz"
        )
        yield f"verdict, {each.rights}: this machine keeps {keeps}"


def record_of(measured: Sequence[Measured], refused: str) -> dict[str, Any]:
    """Return everything for JSON, times in seconds."""
    return {
        "real_time_refused": refused or None,
        "rule": RULE,
        "measured": [
            {
                "rights": each.rights,
                "answers": [answer._asdict() for answer in each.answers],
                "rate_kept_hz": rate_kept_hz(each.rates),
                "wake_ups": [
                    {
                        **one._asdict(),
                        "lateness": durations_report(one.lateness),
                        "done": durations_report(one.done),
                        "is_kept": one.is_kept,
                    }
                    for one in each.rates
                ],
            }
            for each in measured
        ],
    }
