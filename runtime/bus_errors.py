"""Errors on the bus: noise destroys frames, their senders repeat them, and controllers count.

    noise        when a bit is wrong (``bus_noise``)
    consequence  which frame that destroys and how long it takes (``disturbed_frame``)
    counters     of every sender that has been on the bus (``fault_confinement``)

Everyone but the sender receives: each other sender has a receive counter. Errors that one receiver
alone sees are not modelled, and someone always acknowledges.
"""

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from .bus_noise import BusNoise
from .disturbed_frame import Disturbed, disturb
from .fault_confinement import ControllerState, ErrorCounters
from .frame import Frame
from .frame_on_wire import frame_on_wire

SUSPEND_BITS = 8
"""How much longer than others an error passive sender waits after a frame of its own."""
BUS_OFF_SEQUENCES, SEQUENCE_BITS = 128, 11


class ErrorEvent(NamedTuple):
    """One destroyed transmission, as the sender's controller reports it.

    ``time_ns``   end of the error delimiter [ns]
    ``state``     of the sender's controller afterwards; ``has_changed`` with this error
    """

    time_ns: int
    sender: int
    frame: Frame
    cause: str
    field: str
    transmit_errors: int
    receive_errors: int
    state: ControllerState
    has_changed: bool


class BusErrors:
    """What a BusModel asks about errors; one for each bus.

    ``noise``     when bits are wrong
    ``on_error``  called for every destroyed transmission
    """

    def __init__(
        self, noise: BusNoise, on_error: Callable[[ErrorEvent], None] | None = None
    ) -> None:
        self._noise = noise
        self.on_error = on_error
        self._counters: dict[int, ErrorCounters] = {}
        self.causes: Counter[str] = Counter()
        self.received_twice = 0
        self.bus_offs = 0

    def join(self, sender: int) -> None:
        """Have a counter for this sender."""
        self._counters.setdefault(sender, ErrorCounters())

    def is_passive(self, sender: int) -> bool:
        """Whether the sender must pause after its frames."""
        return self._counters[sender].is_passive

    def is_off(self, sender: int) -> bool:
        """Whether the sender takes no part."""
        return self._counters[sender].state is ControllerState.BUS_OFF

    def restart(self, sender: int) -> None:
        """Let a sender take part again."""
        self._counters[sender].restart()

    def transmission(
        self, frame: Frame, sender: int, start_ns: float, bit_ns: float, data_bit_ns: float
    ) -> Disturbed | None:
        """Return what noise does to a frame from ``start_ns`` on; None if it stays whole.

        ``bit_ns``, ``data_bit_ns``  length of a nominal and of a data bit [ns]
        """
        # A whole frame cannot take longer, so that its bits are only laid out when one is hit.
        longest_ns = (len(frame.data) * 10 + 120) * bit_ns
        hit_ns = self._noise.first_hit_ns(int(start_ns), int(start_ns + longest_ns))
        if hit_ns is None:
            return None
        end_ns = start_ns
        for index, bit in enumerate(frame_on_wire(frame)):  # noise is rare, so this is too
            end_ns += data_bit_ns if bit.is_fast else bit_ns
            if hit_ns < end_ns:
                return disturb(frame, index, is_passive=self.is_passive(sender))
        return None

    def on_whole(self, sender: int) -> None:
        """Count a frame that was sent and received."""
        for member, counters in self._counters.items():
            if member == sender:
                counters.on_sent()
            else:
                counters.on_received()

    def on_disturbed(self, disturbed: Disturbed, sender: int, frame: Frame, time_ns: int) -> None:
        """Count a destroyed transmission and report it."""
        own = self._counters[sender]
        before = own.state
        for member, counters in self._counters.items():
            if member == sender and disturbed.is_transmit_error:
                counters.on_transmit_error()
            elif not disturbed.is_received or member == sender:
                counters.on_receive_error()
            else:
                counters.on_received()
        self.causes[disturbed.cause] += 1
        self.received_twice += disturbed.is_received
        self.bus_offs += own.state is ControllerState.BUS_OFF
        if self.on_error is not None:
            event = ErrorEvent(
                time_ns,
                sender,
                frame,
                disturbed.cause,
                disturbed.field,
                own.transmit,
                own.receive,
                own.state,
                own.state is not before,
            )
            self.on_error(event)
