"""A process that is killed, or stopped for a while and always continued.

It is held by a descriptor (``pidfd_open(2)``) from the start, so that a signal never hits another
process that got its number meanwhile.

CLOCK_MONOTONIC can be neither set nor offset for a running process (clock_settime(2),
time_namespaces(7)). A program for which it jumps has not run meanwhile: it has been paused.
"""

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

from ...runtime.exit_status import printable
from ...runtime.node import NS_PER_S
from ...runtime.settings import SettingsError
from .live_faults import LiveFault, LiveKind

_NAME_LENGTH_MAX = 60


class ProcessFault:
    """One fault of one process; ``close`` continues it if it is stopped then.

    Raises SettingsError for a process that is not there or is another user's.
    """

    def __init__(self, fault: LiveFault, start_ns: int) -> None:
        self.fault = fault
        self.name = ""
        self.is_stopped = False
        self._descriptor = _opened(fault)
        self.name = process_name(fault.pid)
        onset_ns = start_ns + round(fault.onset_s * NS_PER_S)
        self._plan = [(onset_ns, signal.SIGKILL)]
        if fault.kind is not LiveKind.KILL:
            end_ns = start_ns + round(fault.end_s * NS_PER_S)
            self._plan = [(onset_ns, signal.SIGSTOP), (end_ns, signal.SIGCONT)]

    @property
    def where(self) -> str:
        """The process it acts on."""
        return f"process {self.fault.pid}"

    @property
    def next_due_ns(self) -> int | None:
        """When the next signal is due [ns]; None when there is none."""
        return self._plan[0][0] if self._plan else None

    def act(self, now_ns: int) -> str:
        """Send the signal that is due; returns the action, empty for none."""
        if not self._plan or now_ns < self._plan[0][0]:
            return ""
        _, number = self._plan.pop(0)
        try:
            signal.pidfd_send_signal(self._descriptor, number)
        except ProcessLookupError:
            self._plan.clear()
            self.is_stopped = False
            return "had ended already"
        self.is_stopped = number is signal.SIGSTOP
        return number.name

    def close(self) -> str:
        """Continue a stopped process, and release it; returns the action."""
        done = ""
        if self.is_stopped:
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._descriptor, signal.SIGCONT)
                done = "SIGCONT"
            self.is_stopped = False
        os.close(self._descriptor)
        return done


def process_name(pid: int) -> str:
    """Return the command line of a process, as far as it may be read."""
    with suppress(OSError):
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
        text = printable(" ".join(word.decode(errors="replace") for word in words if word))
        return text if len(text) <= _NAME_LENGTH_MAX else f"...{text[-_NAME_LENGTH_MAX:]}"
    return ""


def _opened(fault: LiveFault) -> int:
    if sys.platform != "linux":
        raise SettingsError(f"{fault.kind}: only Linux can hold a process by a descriptor")
    if fault.pid == os.getpid():
        raise SettingsError(f"{fault.kind}: process {fault.pid} is this program itself")
    try:
        descriptor = os.pidfd_open(fault.pid)
    except OSError as error:
        cause = "there is none" if isinstance(error, ProcessLookupError) else error.strerror
        raise SettingsError(f"{fault.kind}: process {fault.pid}: {cause}") from error
    try:
        signal.pidfd_send_signal(descriptor, 0)
    except OSError as error:
        os.close(descriptor)
        raise SettingsError(f"{fault.kind}: process {fault.pid}: {error.strerror}") from error
    return descriptor
