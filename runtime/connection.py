"""A node's connection to the bus: counts its error frames, and reopens a bus that was lost.

    CONNECTED  the port's frames come and go
    SILENT     bus-off: the CAN controller has switched itself off. The port stays open, nothing is
               sent; word of a restart ends it, or the carrier of the network interface. What
               the kernel contradicts is a forged one, and only counted
    LOST       the port has failed and is closed; a thread opens it again every RETRY_S

A connection that is not to be kept raises BusError instead of leaving CONNECTED. One that is to be
kept raises it when an outage lasts too long. An outage ends when a port that was opened again has
received a frame, or has not failed when asked for one after SETTLED_S: an adapter that can be
opened but fails at once has not come back, however late that is found. Meanwhile the node runs on,
receives nothing, and what it sends is refused.
"""

import os
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import NamedTuple

import can

from .bus import BusError, has_carrier
from .can_state import is_in_bus_off
from .error_frames import BUS_OFF, FORGED_BUS_OFF, RESTARTED, UNSPECIFIED, error_causes
from .frame import ERROR, Frame
from .node import NEVER_NS, NS_PER_S
from .port import ClosablePort, OpenPort
from .real_time import Received

RETRY_S = 0.5
SETTLED_S = 1.0
REPORTED_OUTAGES_MAX = 10
"""Outages that are reported; further ones are only counted."""
_RETRY_NS = round(RETRY_S * NS_PER_S)
_SETTLED_NS = round(SETTLED_S * NS_PER_S)
_STOP_TIMEOUT_S = 5.0


class ConnectionFigures(NamedTuple):
    """What has become of a connection.

    ``driver``          what the port is made of
    ``error_frames``    causes that error frames have named, and how often
    ``frames_dropped``  frames that the receiving socket had no room for, where that is known
    ``outages``         how often the bus was lost; ``reconnections`` how often it came back
    ``outage_ns``       how long it was lost, all together [ns]
    """

    driver: str
    error_frames: Mapping[str, int]
    frames_dropped: int
    outages: int
    reconnections: int
    outage_ns: int


class Connection:
    """Is the port of a node's executor; ``shutdown`` it at the end.

    ``opened``       the port, which is this connection's to shut down from now on
    ``patience_s``   how long an outage may last [s]; 0 lets none begin
    ``report``       is called with one line for the user about an outage
    """

    def __init__(
        self,
        opened: OpenPort,
        patience_s: float = 0.0,
        report: Callable[[str], None] = lambda _line: None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._opened = opened
        self._port: ClosablePort | None = opened.port
        self._patience_s = patience_s
        self._report = report
        self._clock_ns = clock_ns
        self._error_frames: Counter[str] = Counter()
        self._dropped = 0
        self._outages = 0
        self._reconnections = 0
        self._outage_ns = 0
        self._lost_at_ns = NEVER_NS  # while there is an outage: since when
        self._reopened_at_ns = 0
        self._is_silent = False
        self._look_at_ns = 0  # while silent: when to look whether the bus is back
        self._cause = ""
        self._reopener: _Reopener | None = None

    @property
    def figures(self) -> ConnectionFigures:
        """Figures of the connection so far."""
        outage_ns = self._outage_ns
        if self._lost_at_ns != NEVER_NS:
            outage_ns += self._clock_ns() - self._lost_at_ns
        return ConnectionFigures(
            self._opened.driver,
            dict(sorted(self._error_frames.items())),
            self._dropped + _dropped(self._port),
            self._outages,
            self._reconnections,
            outage_ns,
        )

    def recv(self, timeout_s: float) -> Received | None:
        """Return the next frame, or None when none comes within ``timeout_s`` [s].

        Error frames are returned too. Raises BusError when the bus is lost for good.
        """
        if self._lost_at_ns != NEVER_NS:
            self._watch_outage()
        if self._port is None:
            self._wait_for_port(timeout_s)
            return None
        try:
            received = self._port.recv(timeout_s)
        except BusError as error:
            self._lose(str(error))
            return None
        if received is not None and received.frame.flags & ERROR:
            self._take_error_frame(received.frame)
        elif (self._lost_at_ns != NEVER_NS and not self._is_silent) and (
            received is not None or self._clock_ns() - self._reopened_at_ns > _SETTLED_NS
        ):
            self._end_outage()
        return received

    def send(self, frame: Frame) -> bool:
        """Hand ``frame`` to the bus; returns whether it is there and had room.

        Raises BusError when the bus is lost for good.
        """
        if self._port is None or self._is_silent:
            return False
        try:
            return self._port.send(frame)
        except BusError as error:
            self._lose(str(error))
            return False

    def shutdown(self) -> None:
        """Leave the bus, or give up waiting for it; raises what the port raises."""
        if self._reopener is not None:
            opened = self._reopener.stop()
            self._reopener = None
            self._port = None if opened is None else opened.port
        if self._port is not None:
            self._port.shutdown()

    def _take_error_frame(self, frame: Frame) -> None:
        """Count an error frame, and act on those of the end and the return of the bus."""
        causes = error_causes(frame) if self._opened.is_socketcan else (UNSPECIFIED,)
        if BUS_OFF in causes and self._is_disproved():
            causes = tuple(FORGED_BUS_OFF if one == BUS_OFF else one for one in causes)
        self._error_frames.update(causes)
        if BUS_OFF in causes:
            self._begin_outage(
                "bus-off: the CAN controller has switched itself off after too many errors"
            )
            self._is_silent = True
            self._look_at_ns = self._clock_ns() + _RETRY_NS
        elif self._is_silent and RESTARTED in causes:
            self._end_outage()

    def _is_disproved(self) -> bool:
        """Whether the kernel knows that there is no bus-off."""
        return self._opened.has_carrier and is_in_bus_off(self._opened.channel) is False

    def _lose(self, cause: str) -> None:
        """Close the port that has failed, and have it opened again."""
        self._begin_outage(cause)
        self._dropped += _dropped(self._port)
        port, self._port = self._port, None
        self._is_silent = False
        self._reopener = _Reopener(port, self._opened.reopen)

    def _begin_outage(self, cause: str) -> None:
        """Note that the bus is lost; raises BusError where that is the end."""
        if not self._patience_s:
            raise BusError(cause)
        self._cause = cause
        if self._lost_at_ns == NEVER_NS:
            self._lost_at_ns = self._clock_ns()
            self._outages += 1
            if self._outages <= REPORTED_OUTAGES_MAX:
                last = "; more are only counted" if self._outages == REPORTED_OUTAGES_MAX else ""
                self._report(
                    f"{cause}; waiting {self._patience_s:g} s at most for the bus to return{last}"
                )

    def _end_outage(self) -> None:
        """Note that the bus is back."""
        lasted_ns = self._clock_ns() - self._lost_at_ns
        self._lost_at_ns = NEVER_NS
        self._is_silent = False
        self._outage_ns += lasted_ns
        self._reconnections += 1
        if self._outages <= REPORTED_OUTAGES_MAX:
            self._report(f"the bus is back after {lasted_ns / NS_PER_S:.2f} s")

    def _watch_outage(self) -> None:
        """End an outage that is over; raises BusError when it has lasted too long."""
        now_ns = self._clock_ns()
        if self._is_silent and now_ns >= self._look_at_ns:
            # To be error-active again is not enough: the queue is opened with the carrier.
            self._look_at_ns = now_ns + _RETRY_NS
            if self._opened.has_carrier and has_carrier(self._opened.channel):
                self._end_outage()
                return
        is_away = self._port is None or self._is_silent
        if is_away and now_ns - self._lost_at_ns > self._patience_s * NS_PER_S:
            last = self._reopener and self._reopener.obstacle
            latest = f"; the last attempt: {last}" if last else ""
            raise BusError(
                f"{self._cause}; the bus has not returned for {self._patience_s:g} s{latest}"
            )

    def _wait_for_port(self, timeout_s: float) -> None:
        """Take over what the thread has opened, if it has by the end of ``timeout_s`` [s]."""
        if self._reopener is None:
            raise BusError("this connection is shut down")
        opened = self._reopener.wait(timeout_s)
        if opened is not None:
            self._opened, self._port, self._reopener = opened, opened.port, None
            self._reopened_at_ns = self._clock_ns()


class _Reopener:
    """Closes what has failed and opens it again, in a thread: both may take seconds.

    ``obstacle``  why the last attempt failed
    """

    def __init__(self, failed: ClosablePort | None, reopen: Callable[[], OpenPort]) -> None:
        self.obstacle = ""
        self._failed = failed
        self._reopen = reopen
        self._opened: OpenPort | None = None
        self._stop = threading.Event()
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="reopener", daemon=True)
        self._thread.start()

    def wait(self, timeout_s: float) -> OpenPort | None:
        """Wait for the open port."""
        return self._opened if self._done.wait(max(timeout_s, 0.0)) else None

    def stop(self) -> OpenPort | None:
        """Give up; returns what was opened nevertheless, for the caller to shut down."""
        self._stop.set()
        self._thread.join(_STOP_TIMEOUT_S)
        return self._opened

    def _run(self) -> None:
        with suppress(OSError):
            if sys.platform == "linux":
                # Not the priority of the loop that it was started from; 0 is this thread.
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        with suppress(can.CanError, OSError):
            if self._failed is not None:
                self._failed.shutdown()
        self._failed = None  # an adapter's port may not close before it is forgotten
        while not self._stop.wait(RETRY_S):
            try:
                self._opened = self._reopen()
            except BusError as error:
                self.obstacle = str(error)
            else:
                break
        self._done.set()


def _dropped(port: ClosablePort | None) -> int:
    """Return the frames that a port knows it has missed."""
    return int(getattr(port, "dropped", 0))
