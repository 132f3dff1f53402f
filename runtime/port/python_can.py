"""Port to any python-can interface, opened by python-can's own conventions.

Nodes open their bus with ``runtime.port.port``, which has a faster way for SocketCAN. Which
interface it is decides ``interface_choice``.
"""

import argparse
import difflib
import errno
import importlib
import inspect
import re
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Protocol

import can
import can.cli
from can.interfaces import BACKENDS

from ..exit_status import BusError, one_line
from ..frame import Frame
from ..frame.message import frame_of, message_of
from ..node.real_time_loop import Port, Received
from .interface_choice import AUTO_CHANNEL, Choice, socketcan_obstacle

_SENT_MAX = 64
"""Most frames on their way back to their sender: 16 ms of a 500 kbit/s bus of its own."""
_FULL_CODES = {
    "PcanCanOperationError": (0x01, 0x80),  # PCAN_ERROR_XMTFULL, PCAN_ERROR_QXMTFULL
    "CANLIBOperationError": (-13,),  # Kvaser: canERR_TXBUFOFL
    "VectorOperationError": (11,),  # XL_ERR_QUEUE_IS_FULL
}
"""Codes of drivers whose transmit queue is full, by python-can's exception for their failures."""


_HASTY_MAX = 10_000
"""Waits that end early without a frame: an interface does so whose connection has ended
(socketcand)."""
_OUTWEIGHED = 10
"""Hasty waits, by one that lasted: on a busy machine a hasty one may last by chance."""
_SHORT_S = 1e-3
"""A shorter wait does not tell whether an interface waits."""


_OF_EVERY_BUS = {"bitrate", "data_bitrate", "fd", "timing", "can_filters", "single_handle"}


class ClosablePort(Port, Protocol):
    """A port that has to be shut down."""

    def shutdown(self) -> None:
        """Release its resources."""


def open_bus(namespace: argparse.Namespace, choice: Choice) -> tuple[can.BusABC, str]:
    """Open the bus that was chosen; returns it, for the caller to shut down, and its description.

    Raises BusError.
    """
    check_openable(choice)
    given = {"interface": choice.interface, "channel": choice.channel}
    _refuse_misspelt(choice, getattr(namespace, "bus_kwargs", {}))
    try:
        bus = can.cli.create_bus_from_namespace(namespace, **given)
    except argparse.ArgumentError as error:
        # It wraps any exception of the interface: OSError for a missing SocketCAN interface,
        # ImportError for a missing driver.
        cause = _cause(error.__cause__ or error)
        raise BusError(f"cannot open {choice.name} ({choice.reason}): {cause}") from error
    # Some interfaces of python-can leave channel_info unset.
    what = choice.name if bus.channel_info == can.BusABC.channel_info else bus.channel_info
    return bus, f"{what} ({choice.reason})"


def _cause(error: BaseException) -> str:
    text = one_line(error)
    # What python-can's interfaces raise where the vendor's library is not there.
    if isinstance(
        error, NameError | AttributeError | ImportError | can.CanInterfaceNotImplementedError
    ):
        return f"its driver or library is not installed on this machine ({text})"
    if isinstance(error, TypeError) and (names := re.findall("'(\\w+)'", text)):
        return f"give it --bus-kwargs {' '.join(f'{name}=...' for name in names)} ({text})"
    return text


def _refuse_misspelt(choice: Choice, given: Iterable[str]) -> None:
    """Raise BusError for an argument that is nearly one of the interface; python-can ignores it."""
    module, name = BACKENDS.get(choice.interface, ("", ""))
    try:
        kind = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError, NameError, OSError):
        return  # opening it says why
    known = {
        one for base in kind.__mro__ for one in inspect.signature(base.__init__).parameters
    } | _OF_EVERY_BUS
    for one in given:
        close = difflib.get_close_matches(one, known - {"self", "args", "kwargs"}, 1, 0.7)
        if one not in known and close:
            what = f"{choice.interface} has no argument {one}"
            raise BusError(f"cannot open {choice.name}: {what} (did you mean {close[0]}?)")


def check_openable(choice: Choice) -> None:
    """Raise BusError if python-can could not open the network interface."""
    if choice.interface == "socketcan":
        # Without a channel python-can opens all of them, and cannot send.
        obstacle = (
            socketcan_obstacle(choice.channel)
            if choice.channel
            else f"no channel was given (such as -c {AUTO_CHANNEL})"
        )
        if obstacle:
            raise BusError(f"cannot open {choice.name}: {obstacle}")


@contextmanager
def shutting_down(bus: ClosablePort) -> Iterator[None]:
    """Shut ``bus`` down at the end of the block.

    Errors are ignored: a bus that has failed, as after an unplugged adapter, has been reported.
    """
    try:
        yield
    finally:
        with suppress(can.CanError, OSError):
            bus.shutdown()


class BusPort:
    """The python-can ``bus`` as the port of a node's executor; takes and returns frames.

    Some buses deliver to a node what it has sent itself: multicast, and adapters that echo. Such a
    frame is dropped, once for each sent. python-can's ``is_rx`` does not tell: on SocketCAN it is
    false for the frames of every program on this machine.
    """

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus
        self._sent: dict[Frame, None] = {}
        """The newest frames sent that have not come back, oldest first."""
        self._hasty = 0
        """Waits that ended early without a frame, less those that others outweigh."""

    def recv(self, timeout_s: float) -> Received | None:
        """Return the next frame, or None when none comes within ``timeout_s`` [s].

        A negative ``timeout_s``, of a deadline that has passed, does not wait. Error frames have
        the flag ERROR. The arrival time is None, because the clock of python-can's time stamps
        differs between interfaces. Raises BusError when the bus has failed.
        """
        while True:
            try:
                message = self._message(max(timeout_s, 0.0))
            except (can.CanError, OSError) as error:
                raise BusError(f"cannot receive: {one_line(error)}") from error
            if message is None:
                return None
            frame = frame_of(message)
            if frame not in self._sent:
                return Received(frame, None)
            del self._sent[frame]
            timeout_s = 0.0

    def _message(self, timeout_s: float) -> can.Message | None:
        """Return the next message as ``bus.recv`` does, whose wait follows the wall clock.

        A wall clock that is set back would make it wait for as long as it was set back.
        """
        bus = self.bus
        if type(bus).recv is not can.BusABC.recv:
            return bus.recv(timeout_s)
        end_s = time.monotonic() + timeout_s
        while True:
            message, is_filtered = bus._recv_internal(timeout=timeout_s)
            if message is not None and (is_filtered or bus._matches_filters(message)):
                self._hasty = 0
                return message
            waited_s, timeout_s = timeout_s, end_s - time.monotonic()
            if timeout_s <= 0.0:
                return None
            if message is None and timeout_s > waited_s / 2:
                self._hasty += 1
            elif message is not None:
                self._hasty = 0
            elif waited_s > _SHORT_S:
                self._hasty = max(self._hasty - _OUTWEIGHED, 0)
            if self._hasty > _HASTY_MAX:
                raise can.CanError("the interface's connection has ended")

    def send(self, frame: Frame) -> bool:
        """Send ``frame`` without waiting; returns whether the bus had room.

        Raises BusError when the bus has failed.
        """
        try:
            self.bus.send(message_of(frame), timeout=0)
        except (can.CanError, OSError, ValueError) as error:
            if _is_full(error):
                return False
            raise BusError(f"cannot send: {one_line(error)}") from error
        self._sent[frame] = None
        if len(self._sent) > _SENT_MAX:
            del self._sent[next(iter(self._sent))]
        return True

    def shutdown(self) -> None:
        """Shut the bus down."""
        self.bus.shutdown()


def _is_full(error: Exception) -> bool:
    """Whether a frame was refused only because the queue is full.

    This is temporary: the bus is overloaded, or no other node acknowledges.
    """
    if isinstance(error, can.CanTimeoutError):
        return True
    code = error.error_code if isinstance(error, can.CanError) else getattr(error, "errno", None)
    if code in _FULL_CODES.get(type(error).__name__, (errno.ENOBUFS, errno.EAGAIN)):
        return True
    # python-can's socketcan gives no code when the queue of the socket is full.
    return "Transmit buffer full" in str(error)
