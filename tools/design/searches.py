"""Searches in worker processes: how far each is, and their end by Ctrl-C or when time is up.

A terminal has a bar for each search; elsewhere there is a line on standard error now and then.
"""

import ctypes
import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, wait
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

from rich.progress import BarColumn, TextColumn, TimeRemainingColumn

from ...closed_loop.reports.terminal import plain_console, progress_bars
from ...runtime.command_line import ending_signals, say
from .search.evolution import Progress, SearchStoppedError

SharedProgress = Any
"""For each search how much of it is done, and its least cost; then whether to stop: an array of
2 n + 1 numbers."""

_SHARED: list[SharedProgress] = []
_POLL_S = 0.2
_LINE_EVERY_S = 10.0


def begin_worker(shared: SharedProgress) -> None:
    """Keep the memory in which this worker's searches report."""
    _SHARED[:] = [shared]


def report_from(place: int, minutes: float = math.inf) -> Progress:
    """Return the progress of the search at a place, which ends it after some minutes."""
    end_s = time.monotonic() + 60.0 * minutes

    def show(done: float, best: float) -> None:
        for shared in _SHARED:
            shared[2 * place : 2 * place + 2] = done, best
            if shared[-1]:
                raise SearchStoppedError
        if time.monotonic() > end_s:
            raise SearchStoppedError

    return show


class Searches:
    """The searches of a program, by their names; their workers call ``begin_worker(shared)``."""

    def __init__(self, program: str, names: Sequence[str]) -> None:
        self._program = program
        self._names = names
        self.shared: SharedProgress = get_context("spawn").Array(
            ctypes.c_double, 2 * len(names) + 1, lock=False
        )
        self.is_stopped = False

    @contextmanager
    def stopped_by_ctrl_c(self) -> Iterator[None]:
        """End the searches at the first Ctrl-C in the block; the second is KeyboardInterrupt."""
        with ending_signals(self._stop):
            yield

    def _stop(self, _number: int, _frame: Any) -> None:
        if self.is_stopped:
            raise KeyboardInterrupt
        self.is_stopped, self.shared[-1] = True, 1.0
        text = "ending with the best so far; Ctrl-C again ends at once"
        say(self._program, text, sys.stderr)

    def watch(self, futures: Mapping[str, Future[Any]]) -> None:
        """Show how far the searches are until all of them have ended."""
        console, begin_s = plain_console(), time.monotonic()
        columns = TextColumn("{task.description:10}"), BarColumn(30), TimeRemainingColumn()
        best_column = TextColumn("{task.fields[best]}")
        with progress_bars(console, *columns, best_column) as bars:
            tasks = {name: bars.add_task(name, total=1.0, best="") for name in futures}
            waiting, shown_s = set(futures.values()), begin_s
            while waiting:
                _, waiting = wait(waiting, timeout=_POLL_S)
                if self.is_stopped:
                    for future in waiting:
                        future.cancel()
                going = {}
                for name, future in futures.items():
                    place = 2 * self._names.index(name)
                    done, best = self.shared[place : place + 2]
                    shown = f"best {best:.4g}" if 0.0 < best < 1e3 else ""
                    done = 1.0 if future.done() else done
                    bars.update(tasks[name], completed=done, best=shown)
                    if future in waiting:
                        going[name] = f"{name} {100.0 * done:.0f} %"
                now_s = time.monotonic()
                if going and not console.is_terminal and now_s - shown_s >= _LINE_EVERY_S:
                    shown_s = now_s
                    text = f"{now_s - begin_s:.0f} s: {', '.join(going.values())} of the search"
                    say(self._program, text, sys.stderr)
