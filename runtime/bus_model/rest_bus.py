"""The rest bus: periodic messages of all other nodes, released one after the other.

Each message has a transmit buffer of one frame: a release that finds it full is refused.
"""

from collections.abc import Sequence
from heapq import heapify, heapreplace
from random import Random
from typing import NamedTuple

from ..frame import Frame
from ..frame.frame import arbitration_field
from .bit_ticks import BitTicks

COUNTS = 16
"""Frames of a message before its payloads repeat: a counter of four bits."""


class PeriodicMessage(NamedTuple):
    """One message.

    ``sender``  number of its node, negative
    ``frames``  in turn, COUNTS of them
    """

    name: str
    sender: int
    frames: tuple[Frame, ...]
    period_ns: int


class Traffic(NamedTuple):
    """The messages of a rest bus, and the seed of their phases."""

    messages: Sequence[PeriodicMessage] = ()
    seed: int = 1


NO_TRAFFIC = Traffic()


class RestBus:
    """The messages of one bus."""

    def __init__(self, traffic: Traffic, ticks: BitTicks) -> None:
        ranked = sorted(traffic.messages, key=lambda one: arbitration_field(one.frames[0]))
        self._messages = ranked
        draw = Random(traffic.seed)  # noqa: S311 - reproducible, not secret
        self._due = [(draw.randrange(one.period_ns), rank) for rank, one in enumerate(ranked)]
        """When each is released next, the most urgent of those at one instant first; a heap."""
        heapify(self._due)
        self.next_due_ns = self._due[0][0]
        self._counts = [0] * len(ranked)
        self._ready = [
            [(arbitration_field(it), ticks.of_frame(it), one.sender, it) for it in one.frames]
            for one in ranked
        ]

    @property
    def ready(self) -> tuple[int, int, int, Frame]:
        """Arbitration field, duration in ticks, sender and frame of what is released next."""
        rank = self._due[0][1]
        return self._ready[rank][self._counts[rank] % COUNTS]

    def release(self, *, counts_on: bool) -> None:
        """Go on to the next release; the payload of one that was refused comes again."""
        due_ns, rank = self._due[0]
        self._counts[rank] += counts_on
        heapreplace(self._due, (due_ns + self._messages[rank].period_ns, rank))
        self.next_due_ns = self._due[0][0]
