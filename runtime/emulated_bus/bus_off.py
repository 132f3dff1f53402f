"""Bus-off: a CAN controller that takes no part in the bus, and how it recovers.

It is started again after a while, as by ``restart-ms`` of a SocketCAN interface or by hand. ISO
11898-1 then has it see 128 sequences of 11 recessive bits before it takes part. Each frame on the
bus ends in one: acknowledge delimiter, end of frame and intermission. An idle bus is recessive, so
that it takes 2.8 ms there at 500 kbit/s, and twelve times as long on one that is full.

Its client receives the error frames that SocketCAN would deliver (linux/can/error.h).
"""

from ..bus_model import BusLoad
from ..frame import ERROR, Frame
from ..node import NS_PER_S

BUS_OFF_FRAME = Frame(0x040, bytes(8), ERROR)
RESTARTED_FRAME = Frame(0x100, bytes(8), ERROR)
SEQUENCES, SEQUENCE_BITS = 128, 11


class Recovery:
    """The way back of one controller; never earlier than the bus lets it, by a frame at most later.

    ``restart_ns``     when it is started again [ns]; may be moved until then
    ``bitrate_bit_s``  of the bus [bit/s]
    """

    def __init__(self, restart_ns: int, bitrate_bit_s: int) -> None:
        self.restart_ns = restart_ns
        self._sequence_ns = SEQUENCE_BITS * NS_PER_S // bitrate_bit_s
        self._before: BusLoad | None = None
        self._seen = 0
        self._next_look_ns = restart_ns

    @property
    def next_look_ns(self) -> int:
        """When it may be over at the earliest, as far as is known [ns]."""
        return self.restart_ns if self._before is None else self._next_look_ns

    def is_over(self, now_ns: int, load: BusLoad, quiet_ns: int) -> bool:
        """Whether it takes part again.

        ``load``      what the bus has carried by now
        ``quiet_ns``  a time at which nothing was on the wire that ``load`` does not count [ns]
        """
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
