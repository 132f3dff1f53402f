"""What all programs share: signals, lines on the terminal, exit status."""

import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from enum import IntEnum
from types import FrameType
from typing import Any, TextIO

import can

from ..node import NEVER_NS
from ..port.python_can import BusError
from ..settings import SettingsError
from .thresholds import Condition, Quantity, failures

BLOCKED_S = 2.0
"""How long a line waits for a full pipe; then this line and all later ones are dropped."""


class ExitStatus(IntEnum):
    """Exit status of the programs."""

    OK = 0
    SETTINGS = 2
    BUS = 3
    OUTPUT = 4
    """A file could not be written."""
    SAFE_STATE = 5
    """The node has detected a fault in itself and stays in its safe state."""
    CONDITION = 6
    """The run has met a condition of ``--fail-if``."""
    INTERRUPTED = 130
    """Ctrl-C or SIGTERM outside of a run. An interrupted run ends with OK and a report."""


class StopRequest:
    """Becomes true when the run has to end, and keeps the reason."""

    def __init__(self, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._clock_ns = clock_ns
        self._end_ns = NEVER_NS
        self.reason = ""

    def __call__(self) -> bool:
        """Whether the run is to end."""
        if not self.reason and self._clock_ns() >= self._end_ns:
            self.reason = "duration"
        return bool(self.reason)

    def end_at(self, end_ns: int) -> None:
        """Let the run end at ``end_ns`` at the latest."""
        self._end_ns = end_ns

    @contextmanager
    def on_signals(self) -> Iterator[None]:
        """Let SIGINT, SIGTERM and SIGHUP end the run, within the block.

        SIGHUP comes with the end of the terminal; below nohup it stays ignored. Terminals and
        wrappers may send a signal twice: the second one must not cost the report.
        """
        numbers = [signal.SIGINT, signal.SIGTERM]
        if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
            numbers.append(signal.SIGHUP)
        with ExitStack() as stack:
            for number in numbers:
                stack.enter_context(handled(number, self._take_signal))
            yield

    def _take_signal(self, number: int, _frame: FrameType | None) -> None:
        self.reason = self.reason or signal.Signals(number).name


@contextmanager
def handled(number: int, handler: Any) -> Iterator[None]:
    """Handle a signal with ``handler`` within the block; only in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread can handle signals
        return
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)


def run_main(name: str, main: Callable[[], int]) -> int:
    """Call ``main``; turns errors that a user can cause into one line and an exit status."""
    try:
        # SIGTERM ends it as Ctrl-C does, so that it leaves nothing behind.
        with handled(signal.SIGTERM, signal.default_int_handler):
            status = main()
        print(end="", flush=True)
        return status
    except SettingsError as error:
        lines, status = str(error).splitlines(), ExitStatus.SETTINGS
    except (BusError, can.CanError) as error:
        lines, status = [str(error)], ExitStatus.BUS
    except BrokenPipeError:
        # The reader has gone, as after "| head".
        _silence(sys.stdout)
        lines, status = [], ExitStatus.OK
    except OSError as error:
        where = error.filename2 or error.filename
        cause = error.strerror or str(error)
        lines = [f"{where}: {cause}" if where else cause]
        status = ExitStatus.OUTPUT
    except UnicodeEncodeError as error:
        # Names on the command line may have any bytes; printing and storing need text.
        lines, status = [f"{error.object[:60]}: is not UTF-8 text"], ExitStatus.OUTPUT
    except KeyboardInterrupt:
        lines, status = ["interrupted"], ExitStatus.INTERRUPTED
    for line in lines:
        say(name, f"error: {line}", sys.stderr)
    return status


def fail_status(
    name: str,
    conditions: Sequence[Condition],
    quantities: Mapping[str, Quantity],
    report: Mapping[str, Any],
) -> ExitStatus:
    """Print a line for each ``--fail-if`` that a run meets; returns CONDITION if there is one."""
    lines = failures(conditions, quantities, report)
    for line in lines:
        say(name, line, sys.stderr)
    return ExitStatus.CONDITION if lines else ExitStatus.OK


def say(name: str, text: str, stream: TextIO | None = None) -> None:
    """Print one line to ``stream``, standard output unless given, at once.

    A closed pipe, a full disk or a reader that reads no further must neither keep a run from its
    end nor cost its report.
    """
    stream = stream or sys.stdout
    try:
        if not _takes_a_line(stream):
            raise BlockingIOError
        print(f"{name}: {text}", file=stream, flush=True)
    except OSError:
        _silence(stream)


def _takes_a_line(stream: TextIO) -> bool:
    """Whether ``stream`` takes a line without blocking, now or within BLOCKED_S.

    A terminal that somebody has stopped is waited for: they see it, and can let it go on.
    """
    try:
        descriptor = stream.fileno()
    except OSError:  # in memory
        return True
    if stream.isatty() or os.name != "posix":  # elsewhere select knows sockets only
        return True
    return bool(select.select([], [descriptor], [], BLOCKED_S)[1])


def _silence(stream: TextIO) -> None:
    """Redirect ``stream`` to nowhere, including what Python still buffers."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())
