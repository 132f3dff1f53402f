"""Progress of a run in virtual time: how much is left, and what its nodes warn of, as it happens.

A terminal shows a bar. Elsewhere a line comes every LINE_S, so that a log tells a slow run from one
that hangs.
"""

import math
import time
from collections.abc import Callable
from contextlib import AbstractContextManager

from rich.progress import BarColumn, TextColumn, TimeRemainingColumn

from ...closed_loop.reports.terminal import plain_console, progress_bars
from ...runtime.node import NS_PER_S, ReportingNode
from .result import NAME

LINE_S = 10.0
_WARNINGS = ("path", "signals", "validity", "revision")
"""States of the nodes' views that are warnings."""


class RunProgress(AbstractContextManager["RunProgress"]):
    """Shows how far the run of ``nodes`` is; ``step`` is called before every second of it.

    ``duration_s``  how long the run is to last
    """

    def __init__(
        self,
        nodes: tuple[ReportingNode, ...],
        duration_s: float,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._nodes, self._duration_s, self._clock_s = nodes, duration_s, clock_s
        self._done_s, self._begin_s = -1, clock_s()
        self._line_s = self._begin_s + LINE_S
        self._said: set[str] = set()
        self._console = plain_console(is_error=True)
        columns = (TextColumn("{task.description}"), BarColumn(30), TimeRemainingColumn())
        self._bars = progress_bars(self._console, *columns)
        self._bar = self._bars.add_task("", total=math.ceil(duration_s))

    def __enter__(self) -> "RunProgress":
        """Show the bar."""
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the bar."""
        self._bars.stop()

    def step(self) -> None:
        """Show how many seconds have been run, and what the nodes warn of since then."""
        self._done_s += 1
        text = f"{self._done_s} s of {self._duration_s:g} s"
        self._bars.update(self._bar, completed=self._done_s, description=text)
        for node in self._nodes:
            states = node.view(self._done_s * NS_PER_S).states
            for warning in {states.get(name, "") for name in _WARNINGS} - self._said - {""}:
                self._said.add(warning)
                self._console.print(f"{NAME}: {self._done_s} s: {warning}")
        if not self._console.is_terminal and self._clock_s() >= self._line_s:
            self._line_s += LINE_S
            left_s = (self._duration_s - self._done_s) * (self._clock_s() - self._begin_s)
            self._console.print(f"{NAME}: {text}, about {left_s / max(self._done_s, 1):.0f} s left")
