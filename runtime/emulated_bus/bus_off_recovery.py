"""Bus-off: a CAN controller that takes no part in the bus, and how it recovers.

In a bus-off that a client has requested, the controller is started again after a while, as by
``restart-ms`` of a SocketCAN interface or by hand. By ISO 11898-1 it must then see 128 sequences of
11 recessive bits before it takes part. Each frame on the bus ends in one: acknowledge delimiter,
end of frame and intermission. An idle bus is recessive, so that this takes 2.8 ms there at 500
kbit/s, and twelve times as long on a full bus. After a bus-off by errors the controller is started
again at once, and the bus model knows when it takes part.

Its client receives the error frames that SocketCAN would deliver (linux/can/error.h).
"""

from ..bus_model.bus_model import BusLoad
from ..node import NS_PER_S

SEQUENCES, SEQUENCE_BITS = 128, 11


class Recovery:
    """The recovery of one controller: never too early, and at most a frame late.

    ``restart_ns``     when it is started again [ns]; may be moved until then
    ``bitrate_bit_s``  of the bus [bit/s]
    ``end_ns``         when it takes part again, where the bus model says so [ns]
    """

    def __init__(self, restart_ns: int, bitrate_bit_s: int, end_ns: int | None = None) -> None:
        self.restart_ns = restart_ns
        self._end_ns = end_ns
        self._sequence_ns = SEQUENCE_BITS * NS_PER_S // bitrate_bit_s
        self._before: BusLoad | None = None
        self._seen = 0
        self._next_look_ns = restart_ns

    @property
    def next_look_ns(self) -> int:
        """When it may be over at the earliest, as far as is known [ns]."""
        if self._end_ns is not None:
            return self._end_ns
        return self.restart_ns if self._before is None else self._next_look_ns

    def is_over(self, now_ns: int, load: BusLoad, quiet_ns: int) -> bool:
        """Whether it takes part again.

        ``load``      what the bus has carried by now
        ``quiet_ns``  a time at which nothing was on the wire that ``load`` does not count [ns]
        """
        if self._end_ns is not None:
            return now_ns >= self._end_ns
        if now_ns < self.restart_ns:
            return False
        if self._before is None:
            self._before, self.restart_ns = load, now_ns
        idle_ns = quiet_ns - self.restart_ns - (load.busy_ns - self._before.busy_ns)
        seen = load.frames - self._before.frames + max(idle_ns, 0) // self._sequence_ns
        self._seen = max(self._seen, seen)
        left = SEQUENCES - self._seen
        self._next_look_ns = max(quiet_ns + left * self._sequence_ns, now_ns + self._sequence_ns)
        return left <= 0
