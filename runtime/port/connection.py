"""A node's connection to the bus: counts its error frames, and ends with the bus.

In bus-off the CAN controller has switched itself off. A bus-off while the network interface has its
carrier is forged, and only counted: any program on the machine can send such an error frame.
"""

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from ..bus_model.socketcan_error_frames import BUS_OFF, FORGED_BUS_OFF, UNSPECIFIED, error_causes
from ..exit_status import BusError
from ..frame import ERROR, Frame
from ..node.real_time_loop import Received
from .interface_choice import has_carrier
from .port import OpenPort


class ConnectionFigures(NamedTuple):
    """Error frames by cause, and frames for which the receiving socket had no room, if known."""

    driver: str
    error_frames: Mapping[str, int]
    frames_dropped: int


class Connection:
    """The port of a node's executor; ``shutdown`` it at the end.

    ``opened``  the port, which this connection shuts down
    """

    def __init__(self, opened: OpenPort) -> None:
        self._opened, self._port = opened, opened.port
        self._error_frames: Counter[str] = Counter()

    @property
    def figures(self) -> ConnectionFigures:
        """Figures of the connection so far."""
        dropped = int(getattr(self._port, "dropped", 0))
        causes = dict(sorted(self._error_frames.items()))
        return ConnectionFigures(self._opened.driver, causes, dropped)

    def recv(self, timeout_s: float) -> Received | None:
        """Return the next frame, or None when none comes within ``timeout_s`` [s].

        Error frames are returned too. Raises BusError when the bus is lost.
        """
        received = self._port.recv(timeout_s)
        if received is not None and received.frame.flags & ERROR:
            self._count(received.frame)
        return received

    def send(self, frame: Frame) -> bool:
        """Send ``frame``; returns whether the bus had room. Raises BusError when it is lost."""
        return self._port.send(frame)

    def shutdown(self) -> None:
        """Leave the bus; raises what the port raises."""
        self._port.shutdown()

    def _count(self, error_frame: Frame) -> None:
        causes = error_causes(error_frame) if self._opened.is_socketcan else (UNSPECIFIED,)
        is_off = BUS_OFF in causes
        if is_off and self._opened.has_carrier and has_carrier(self._opened.channel):
            causes = tuple(FORGED_BUS_OFF if one == BUS_OFF else one for one in causes)
            is_off = False
        self._error_frames.update(causes)
        if is_off:
            raise BusError(
                "bus-off: the CAN controller has switched itself off after too many errors"
            )
