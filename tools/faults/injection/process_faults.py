"""A process that is killed, or stopped for a while and always continued.

It is held by a descriptor (``pidfd_open(2)``) from the start, so that a signal never hits another
process that got its number meanwhile.

A clock that jumps is a pause of that length. CLOCK_MONOTONIC can be neither set nor offset for a
running process (clock_settime(2), time_namespaces(7)): for a program it jumps only while the
program or its virtual machine does not run. A paused program observes the same, since as many
periods have passed without a tick.

A node's CAN controller that is in bus-off for a while, on an emulated bus.

The broker does it on request and ends it by itself, so that nothing remains when the injector dies.
On a real bus a controller goes into bus-off by errors on the wire, which takes hardware. How the
programs react to that is tested with the kernel's own driver for serial adapters.
"""

import os
import signal
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType

import can

from ....dbc.messages import CAN_IDS, LateralError, SteeringCommand
from ....runtime.emulated_bus.interface import EmulatedBus
from ....runtime.exit_status import BusError, one_line
from ....runtime.node import NS_PER_S
from ....runtime.port.port import ClosablePort
from ....runtime.port.python_can import BusPort
from ....runtime.settings import SettingsError
from .live_faults import LiveFault, LiveKind

_IDENTIFIERS: Mapping[str, int] = MappingProxyType(
    {"plant": CAN_IDS[LateralError], "controller": CAN_IDS[SteeringCommand]}
)
"""Messages that only that node sends; an intruder that forges them would be taken for it."""


class BusOffFault:
    """One fault of one node's CAN controller; ``close`` ends it if it still lasts.

    Raises SettingsError where the bus cannot do that.
    """

    def __init__(self, fault: LiveFault, start_ns: int, port: ClosablePort | None) -> None:
        bus = port.bus if isinstance(port, BusPort) else None
        if not isinstance(bus, EmulatedBus):
            raise SettingsError(f"{fault.kind}: only on an emulated bus (-i emulated)")
        if not bus.takes_bus_off:
            raise SettingsError(
                f"{fault.kind}: this bus does not take it: start its broker with --allow-bus-off"
            )
        self.fault = fault
        self._bus = bus
        self._plan = [start_ns + round(at_s * NS_PER_S) for at_s in (fault.onset_s, fault.end_s)]

    @property
    def where(self) -> str:
        """The node it acts on."""
        return self.fault.of

    @property
    def next_due_ns(self) -> int | None:
        """When there is something to do next [ns]; None for never."""
        return self._plan[0] if self._plan else None

    def act(self, now_ns: int) -> str:
        """Do what is due; returns the action, empty for none. Raises BusError."""
        if not self._plan or now_ns < self._plan[0]:
            return ""
        self._plan.pop(0)
        if self._plan:
            self._ask(max(self._plan[0] - now_ns, 0) / NS_PER_S)
            return "bus-off"
        self._ask(0.0)
        return "restart"

    def close(self) -> str:
        """End it, if it has begun; returns the action."""
        if len(self._plan) != 1:
            return ""
        self._plan.clear()
        try:
            self._ask(0.0)
        except BusError:
            return ""  # the broker has gone, and bus-off with it
        return "restart"

    def _ask(self, restart_after_s: float) -> None:
        try:
            self._bus.send_bus_off(_IDENTIFIERS[self.fault.of], restart_after_s)
        except can.CanError as error:
            raise BusError(f"cannot ask for a bus-off: {one_line(error)}") from error


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
        text = " ".join(word.decode(errors="replace") for word in words if word)
        printable = "".join(one if one.isprintable() else "?" for one in text)
        if len(printable) > _NAME_LENGTH_MAX:
            return "..." + printable[-_NAME_LENGTH_MAX:]
        return printable
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
