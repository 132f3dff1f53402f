"""A node's connection to the bus: counts its error frames, and reopens a bus that was lost.

    CONNECTED  the port's frames come and go
    SILENT     bus-off: the CAN controller has switched itself off. The port stays open, but nothing
               is sent. A report of a restart ends it, or the carrier of the network interface. A
               bus-off while the interface has its carrier is forged, and only counted: any program
               on the machine can send such an error frame
    LOST       the port has failed and is closed; a thread tries to reopen it every RETRY_S

Without reconnecting, the connection raises BusError instead of leaving CONNECTED. With it, it does
so when an outage lasts too long. An outage ends when a reopened port has received a frame, or has
not failed SETTLED_S later: an adapter that opens but fails at once has not come back. Meanwhile the
node keeps running, receives nothing, and its frames are refused.
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

from ..bus_model.socketcan_error_frames import (
    BUS_OFF,
    FORGED_BUS_OFF,
    RESTARTED,
    UNSPECIFIED,
    error_causes,
)
from ..exit_status import BusError
from ..frame import ERROR, Frame
from ..node import NEVER_NS, NS_PER_S
from ..node.real_time_loop import Received
from .interface_choice import has_carrier
from .port import ClosablePort, OpenPort

RETRY_S = 0.5
SETTLED_S = 1.0
REPORTED_OUTAGES_MAX = 10
"""Outages that are reported; further ones are only counted."""
_RETRY_NS = round(RETRY_S * NS_PER_S)
_SETTLED_NS = round(SETTLED_S * NS_PER_S)
_STOP_TIMEOUT_S = 5.0


class ConnectionFigures(NamedTuple):
    """Totals of a connection.

    ``driver``          AF_CAN or python-can
    ``error_frames``    error frames by cause
    ``frames_dropped``  frames for which the receiving socket had no room, if known
    ``outages``         how often the bus was lost; ``reconnections`` how often it came back
    ``outage_ns``       total time without the bus [ns]
    """

    driver: str
    error_frames: Mapping[str, int]
    frames_dropped: int
    outages: int
    reconnections: int
    outage_ns: int


class Connection:
    """The port of a node's executor; ``shutdown`` it at the end.

    ``opened``       the port, which this connection shuts down
    ``patience_s``   how long an outage may last [s]; 0: the first one is the end
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
        self._dropped = self._outages = self._reconnections = self._outage_ns = 0
        self._lost_at_ns = NEVER_NS  # begin of the present outage
        self._reopened_at_ns = 0
        self._is_silent = False
        self._look_at_ns = 0  # while silent: when to check for the bus again
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
        """Send ``frame``; returns whether there is a bus and it had room.

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
        """Leave the bus, or stop waiting for it; raises what the port raises."""
        if self._reopener is not None:
            opened = self._reopener.stop()
            self._reopener = None
            self._port = None if opened is None else opened.port
        if self._port is not None:
            self._port.shutdown()

    def _take_error_frame(self, frame: Frame) -> None:
        """Count an error frame, and react to bus-off and restart."""
        causes = error_causes(frame) if self._opened.is_socketcan else (UNSPECIFIED,)
        if BUS_OFF in causes and self._has_carrier():
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

    def _has_carrier(self) -> bool:
        """Whether the bus is a network interface with its carrier, which is gone in bus-off."""
        return self._opened.has_carrier and bool(has_carrier(self._opened.channel))

    def _lose(self, cause: str) -> None:
        """Close the failed port, and start to reopen it."""
        self._begin_outage(cause)
        self._dropped += _dropped(self._port)
        port, self._port = self._port, None
        self._is_silent = False
        self._reopener = _Reopener(port, self._opened.reopen)

    def _begin_outage(self, cause: str) -> None:
        """Record the loss of the bus; raises BusError if it is not to be reopened."""
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
        lasted_ns = self._clock_ns() - self._lost_at_ns
        self._lost_at_ns = NEVER_NS
        self._is_silent = False
        self._outage_ns += lasted_ns
        self._reconnections += 1
        if self._outages <= REPORTED_OUTAGES_MAX:
            self._report(f"the bus is back after {lasted_ns / NS_PER_S:.2f} s")

    def _watch_outage(self) -> None:
        """End the outage if it is over; raises BusError if it has lasted too long."""
        now_ns = self._clock_ns()
        if self._is_silent and now_ns >= self._look_at_ns:
            # Being error-active again is not enough: the queue opens with the carrier.
            self._look_at_ns = now_ns + _RETRY_NS
            if self._has_carrier():
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
        """Take over the port that the thread opens within ``timeout_s`` [s], if it does."""
        if self._reopener is None:
            raise BusError("this connection is shut down")
        opened = self._reopener.wait(timeout_s)
        if opened is not None:
            self._opened, self._port, self._reopener = opened, opened.port, None
            self._reopened_at_ns = self._clock_ns()


class _Reopener:
    """Closes the failed port and reopens it in a thread, since both may take seconds.

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
        """Stop; returns a port that was opened meanwhile, for the caller to shut down."""
        self._stop.set()
        self._thread.join(_STOP_TIMEOUT_S)
        return self._opened

    def _run(self) -> None:
        with suppress(OSError):
            if sys.platform == "linux":
                # Not the real-time priority of the loop; 0 is this thread.
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        with suppress(can.CanError, OSError):
            if self._failed is not None:
                self._failed.shutdown()
        self._failed = None  # some adapters close only when the object is released
        while not self._stop.wait(RETRY_S):
            try:
                self._opened = self._reopen()
            except BusError as error:
                self.obstacle = str(error)
            else:
                break
        self._done.set()


def _dropped(port: ClosablePort | None) -> int:
    """Return how many frames a port knows to have missed."""
    return int(getattr(port, "dropped", 0))
