"""The rest bus: periodic messages of all other nodes, without an object for each of their frames.

Each message has a transmit buffer of one frame: a release that finds it full is refused. While
all nodes are error active, ``carry`` takes the bus from one such frame to the next with a few
integer operations each. For everything else BusModel takes the frames over one by one, as if they
had been submitted, with the same result.
"""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from itertools import chain
from random import Random
from typing import NamedTuple

from ..frame import Frame
from ..frame.arbitration import NO_FIELD, arbitration_field
from ..frame.length_with_stuff_bits import INTERMISSION_BITS
from ..node import NS_PER_S
from .bit_ticks import BitTicks

COUNTS = 16
"""Frames of a message before its payloads repeat: a counter of four bits."""
_COUNT_MASK = COUNTS - 1
_BLOCK_NS = NS_PER_S
"""Releases are listed in blocks of this length."""
_RANK_BITS = 16

OnWire = Callable[[int, int, Frame], None]
"""Called as ``on_wire(end_ns, sender, frame)``."""


class PeriodicMessage(NamedTuple):
    """One message.

    ``sender``  number of its node, negative
    ``frames``  in turn, COUNTS of them
    """

    name: str
    sender: int
    frames: tuple[Frame, ...]
    period_ns: int


class Ready(NamedTuple):
    """A frame that BusModel takes over.

    ``rank``            of its message
    ``arbitration``     its arbitration field
    ``duration_ticks``  its length
    """

    rank: int
    arbitration: int
    duration_ticks: int
    sender: int
    frame: Frame


class RestBus:
    """The messages of one bus, by rank: 1 is the most urgent.

    ``messages``  those of equal arbitration fields in the order in which they are sent
    ``seed``      of the phases

    ``sent``        complete frames by sender
    ``refused``     releases that found their buffer full
    ``lost``        releases of senders in bus-off
    ``busy_ticks``  time that ``carry`` has filled, intermissions included
    ``on_wire``     called for every complete frame
    """

    def __init__(self, messages: Sequence[PeriodicMessage], seed: int) -> None:
        ranked = sorted(messages, key=lambda one: arbitration_field(one.frames[0]))
        self._messages = [ranked[0], *ranked]  # there is no rank 0
        self._senders = [one.sender for one in self._messages]
        self._arbitration = [arbitration_field(one.frames[0]) for one in self._messages]
        draw = Random(seed)  # noqa: S311 - reproducible, not secret
        self._phases_ns = [0, *(draw.randrange(one.period_ns) for one in ranked)]
        self._counts = [0] * len(self._messages)
        # A bit for each rank, the most urgent lowest: messages that wait here, and in BusModel.
        self._waiting = self._taken = 0
        self._handed_over = 0
        self._index, self._times, self._bits = 0, [0], [0]
        self._block_ns = 0
        self.sent = dict.fromkeys(self._senders, 0)
        self.refused = self.lost = self.busy_ticks = 0
        self.on_wire: OnWire | None = None

    @property
    def frames(self) -> int:
        """Frames that ``carry`` has sent."""
        return sum(self._counts) - self._handed_over

    @property
    def next_due_ticks(self) -> int:
        """When the next message is released."""
        while not self._bits[self._index]:
            self._lay_out()
        return self._times[self._index]

    def join(self, ticks: BitTicks) -> None:
        """Take part in a bus; called by its model."""
        self._ticks = ticks
        self._intermission_ticks = INTERMISSION_BITS * ticks.nominal
        self._durations = [
            [ticks.of_frame(frame) + self._intermission_ticks for frame in one.frames]
            for one in self._messages
        ]

    def carry(self, free_ticks: int, until_ticks: int, rival: int, hit_ticks: int) -> int:
        """Send frames from ``free_ticks`` on; returns when the bus is free again.

        Stops where the next frame would start at ``until_ticks`` or later, where the arbitration
        field ``rival`` wins, and where a frame would still be on the wire at ``hit_ticks``.
        """
        waiting, index, times, bits = self._waiting, self._index, self._times, self._bits
        durations, counts, allowed = self._durations, self._counts, ~self._taken
        senders, sent, on_wire = self._senders, self.sent, self.on_wire
        intermission_ticks = self._intermission_ticks
        loses = 1 << bisect_left(self._arbitration, rival, 1) - 1
        begin_ticks, idle_ticks, hit_ticks = free_ticks, 0, hit_ticks + intermission_ticks
        while free_ticks < until_ticks:
            while times[index] <= free_ticks:
                more = waiting | bits[index] & allowed
                if more != waiting:
                    waiting = more
                elif bits[index]:
                    self.refused += 1
                else:
                    self._lay_out()
                    index, times, bits = 0, self._times, self._bits
                    continue
                index += 1
            if waiting:
                lowest = waiting & -waiting
                if lowest >= loses:
                    break
                rank = lowest.bit_length()
                count = counts[rank]
                next_ticks = free_ticks + durations[rank][count & _COUNT_MASK]
                if next_ticks > hit_ticks:
                    break
                waiting ^= lowest
                counts[rank] = count + 1
                sent[senders[rank]] += 1
                if on_wire is not None:
                    frame = self._messages[rank].frames[count & _COUNT_MASK]
                    end_ticks = next_ticks - intermission_ticks
                    on_wire(self._ticks.whole_ns(end_ticks), senders[rank], frame)
                free_ticks = next_ticks
            elif rival < NO_FIELD or times[index] >= until_ticks:
                break
            else:
                idle_ticks += times[index] - free_ticks
                free_ticks = times[index]
        self._waiting, self._index = waiting, index
        self.busy_ticks += free_ticks - begin_ticks - idle_ticks
        return free_ticks

    @property
    def best(self) -> int:
        """Arbitration field of the most urgent frame that waits here."""
        return self._arbitration[self._lowest_rank()] if self._waiting else NO_FIELD

    def hand_over_best(self) -> Ready:
        """Hand over the most urgent frame that waits here."""
        rank = self._lowest_rank()
        self._waiting ^= 1 << rank - 1
        return self._ready(rank)

    def hand_over_next(self, is_off: Callable[[int, int], bool]) -> Ready | None:
        """Hand over the message that is released next; None if it is refused, or lost.

        ``is_off``  whether a sender is in bus-off at a time [ticks]
        """
        due_ticks = self.next_due_ticks
        bit = self._bits[self._index]
        self._index += 1
        rank = bit.bit_length()
        if is_off(self._senders[rank], due_ticks):
            self.lost += 1
            self._ready(rank)  # the payload counts on
        elif (self._taken | self._waiting) & bit:
            self.refused += 1
        else:
            return self._ready(rank)
        return None

    def hold(self, rank: int) -> None:
        """Note that a frame waits in BusModel."""
        self._taken |= 1 << rank - 1

    def release(self, rank: int) -> None:
        """Note that a frame no longer waits in BusModel."""
        self._taken &= ~(1 << rank - 1)

    def _lowest_rank(self) -> int:
        return (self._waiting & -self._waiting).bit_length()

    def _ready(self, rank: int) -> Ready:
        count = self._counts[rank]
        self._counts[rank] = count + 1
        self._handed_over += 1
        frame = self._messages[rank].frames[count & _COUNT_MASK]
        duration_ticks = self._durations[rank][count & _COUNT_MASK] - self._intermission_ticks
        sender = self._senders[rank]
        return Ready(rank, self._arbitration[rank], duration_ticks, sender, frame)

    def _lay_out(self) -> None:
        """List the releases of the next block in order; the last entry is its end."""
        begin_ns, end_ns = self._block_ns, self._block_ns + _BLOCK_NS
        releases = []
        for rank in range(1, len(self._messages)):
            period_ns, phase_ns = self._messages[rank].period_ns, self._phases_ns[rank]
            first_ns = phase_ns + -((phase_ns - begin_ns) // period_ns) * period_ns
            first_ns = max(first_ns, phase_ns)
            releases.append(
                range(first_ns << _RANK_BITS | rank, end_ns << _RANK_BITS, period_ns << _RANK_BITS)
            )
        in_order = sorted(chain.from_iterable(releases))
        per_ns, mask = self._ticks.per_ns, (1 << _RANK_BITS) - 1
        self._times = [(code >> _RANK_BITS) * per_ns for code in in_order] + [end_ns * per_ns]
        bit_of = [1 << rank >> 1 for rank in range(len(self._messages))]
        self._bits = [bit_of[code & mask] for code in in_order] + [0]
        self._index, self._block_ns = 0, end_ns
