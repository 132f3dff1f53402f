"""Access to the bus: pauses of error passive senders, and bus-off.

An error passive sender pauses 8 bits after each frame of its own. A sender in bus-off takes no part
for 128 times 11 recessive bits. That is the time on an idle bus; that traffic makes it longer is
not modelled here.
"""

from collections.abc import Sequence

from ..frame.length_with_stuff_bits import INTERMISSION_BITS
from .bit_ticks import BitTicks
from .bus_errors import BusErrors
from .transmit_queue import Waiting

_SUSPEND_BITS = 8
_BUS_OFF_BITS = 128 * 11


class BusAccess:
    """The senders of one bus; without ``errors`` all may start whenever it is free.

    ``bus_off_ns``  how long a bus-off lasts [ns]
    """

    def __init__(self, errors: BusErrors | None, ticks: BitTicks) -> None:
        self._errors = errors
        self._ticks = ticks
        self.bus_off_ns = ticks.whole_ns(_BUS_OFF_BITS * ticks.nominal)
        self._paused_until_ticks: dict[int, int] = {}
        self._off_until_ticks: dict[int, int] = {}

    @property
    def is_calm(self) -> bool:
        """Whether all may start whenever the bus is free."""
        return self._errors is None or (self._errors.is_calm and not self._paused_until_ticks)

    def next_start(self, queue: Sequence[Waiting], free_ticks: int) -> tuple[int, Waiting]:
        """When the next frame of a heap starts, as far as is known, and which."""
        paused = self._paused_until_ticks
        if not paused:
            return free_ticks, queue[0]
        start_ticks, _, _, waiting = min(
            (max(free_ticks, paused.get(one.sender, 0)), one.arbitration, one.sequence, one)
            for one in queue
        )
        return start_ticks, waiting

    def goes_off(self, sender: int, end_ticks: int) -> bool:
        """Note the end of a transmission; returns whether its sender is in bus-off now."""
        self._paused_until_ticks.pop(sender, None)
        if self._errors is None or not self._errors.is_passive(sender):
            return False
        if self._errors.is_off(sender):
            self._off_until_ticks[sender] = end_ticks + _BUS_OFF_BITS * self._ticks.nominal
            return True
        pause_ticks = (INTERMISSION_BITS + _SUSPEND_BITS) * self._ticks.nominal
        self._paused_until_ticks[sender] = end_ticks + pause_ticks
        return False

    def come_back(self, now_ticks: int) -> None:
        """Let all take part again whose bus-off is over."""
        if self._off_until_ticks:
            for sender in tuple(self._off_until_ticks):
                self.is_off(sender, now_ticks)

    def is_off(self, sender: int, now_ticks: int) -> bool:
        """Whether a sender is in bus-off; lets it take part again when that is over."""
        if self._errors is None:
            return False
        self._errors.join(sender)
        until_ticks = self._off_until_ticks.get(sender)
        if until_ticks is None:
            return False
        if now_ticks < until_ticks:
            return True
        del self._off_until_ticks[sender]
        self._errors.restart(sender)
        return False


def is_awaited(on_wire: Waiting | None, queue: Sequence[Waiting]) -> bool:
    """Whether a frame waits that a node has submitted."""
    if on_wire is not None and on_wire.sender >= 0:
        return True
    for waiting in queue:  # noqa: SIM110 - asked for twice a frame; any() takes longer
        if waiting.sender >= 0:
            return True
    return False
