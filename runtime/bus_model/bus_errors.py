"""Errors on the bus: noise destroys frames, their senders repeat them, and controllers count.

    noise        when a bit is wrong (``noise``)
    consequence  which frame that destroys and how long it takes (``bit_error_at_all_nodes``,
                 ``bit_error_at_one_node``)
    counters     of every node that has been on the bus (``fault_confinement``)

Everyone but the sender receives: each other node has a receive counter.
"""

from collections import Counter
from collections.abc import Callable, Container, Mapping, Sequence
from itertools import accumulate
from types import MappingProxyType
from typing import NamedTuple

from ..frame import BITRATE_SWITCH, ERROR_STATE, FD, Frame
from ..frame.wire_bits import frame_on_wire
from ..node import NEVER_NS
from .bit_error_at_all_nodes import AFTER_ACK, FIRST, Disturbed, disturb, disturb_stuck
from .bit_error_at_one_node import disturb_receiver, disturb_sender, unacknowledged
from .bit_noise import Noise, StuckLine
from .bit_ticks import BitTicks
from .fault_confinement import BUS_OFF_MIN, PASSIVE_MIN, ControllerState, ErrorCounters

_GONE = -1 << 31
"""Stands for all nodes that have left."""
NO_NOISE: Mapping[int, Noise] = MappingProxyType({})


class ErrorEvent(NamedTuple):
    """One destroyed transmission, as the sender's controller reports it.

    ``time_ns``   end of the error delimiter [ns]
    ``state``     of the sender's controller afterwards; ``has_changed`` with this error
    ``is_repeated``  the frame is sent again, unless its sender is in bus-off
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
    is_repeated: bool


class _Member:
    """A node on the bus: its counters, which lag behind the frames that came through."""

    def __init__(self) -> None:
        self.counters = ErrorCounters()
        self.own_frames = self.all_frames = 0


class BusErrors:
    """What a BusModel asks about errors; one for each bus.

    ``noise``           when bits are wrong for everybody
    ``on_error``        called for every destroyed transmission
    ``noise_of``        when bits are wrong for one node alone
    ``stuck``           when the line is, in order of time
    ``is_acknowledged`` whether somebody is there to acknowledge the frames of a sender

    ``present``   who is on the bus, where nodes come and go; None for everybody
    ``is_calm``   everybody is error active
    ``sent``      complete frames by sender that has joined; whoever sends one counts it here or by
                  ``on_whole``
    """

    def __init__(
        self,
        noise: Noise,
        on_error: Callable[[ErrorEvent], None] | None = None,
        noise_of: Mapping[int, Noise] = NO_NOISE,
        stuck: Sequence[StuckLine] = (),
        is_acknowledged: Callable[[int], bool] | None = None,
    ) -> None:
        self._noise = noise
        self.on_error = on_error
        self._noise_of = noise_of
        self._stuck = list(stuck)
        self._is_acknowledged = is_acknowledged
        self.present: Container[int] | None = None
        self._members: dict[int, _Member] = {}
        self._limited: set[int] = set()
        self.is_calm = True
        self._next_hit_ns = -1
        self.sent = {_GONE: 0}
        self.causes: Counter[str] = Counter()
        self.received_twice = self.missed_by_one = self.bus_offs = 0

    def join(self, node: int) -> None:
        """Give this node counters."""
        if node not in self._members:
            member = self._members[node] = _Member()
            member.all_frames = self._all_frames
            self.sent[node] = 0

    def leave(self, node: int) -> None:
        """Forget a node that is no longer on the bus."""
        self._members.pop(node, None)
        self._limited.discard(node)
        self.is_calm = not self._limited
        self.sent[_GONE] += self.sent.pop(node, 0)

    def counters(self, node: int) -> ErrorCounters:
        """Return a node's counters as they are now."""
        return self._up_to_date(node, self._all_frames).counters

    def is_passive(self, node: int) -> bool:
        """Whether a node must pause after its frames."""
        return node in self._limited and self.counters(node).is_passive

    def as_sent(self, frame: Frame, sender: int) -> Frame:
        """Return a frame as it is on the wire, with ESI recessive if its sender is passive."""
        if frame.flags & FD and self.is_passive(sender):
            return frame._replace(flags=frame.flags | ERROR_STATE)
        return frame

    def is_off(self, node: int) -> bool:
        """Whether a node takes no part."""
        return node in self._limited and (
            self._members[node].counters.state is ControllerState.BUS_OFF
        )

    def restart(self, node: int) -> None:
        """Let a node take part again."""
        self.counters(node).restart()
        self.note_limits(node)

    def next_hit_ns(self, start_ns: int) -> int:
        """Return the first instant from ``start_ns`` on that can be the end of a frame [ns]."""
        if self._is_acknowledged is not None:
            return start_ns
        if start_ns <= self._next_hit_ns:
            return self._next_hit_ns
        hits_ns = [
            noise.first_hit_ns(start_ns, NEVER_NS)
            for noise in (self._noise, *self._noise_of.values())
        ]
        self._stuck = [line for line in self._stuck if line.end_ns > start_ns]
        hits_ns += [line.start_ns for line in self._stuck[:1]]
        self._next_hit_ns = min(hit_ns for hit_ns in (*hits_ns, NEVER_NS) if hit_ns is not None)
        return self._next_hit_ns

    def transmission(
        self, frame: Frame, sender: int, start_ticks: int, end_ticks: int, ticks: BitTicks
    ) -> Disturbed | None:
        """Return what disturbs a frame that would be on the wire for so long; None if it is whole.

        Of several errors the first one counts.
        """
        is_passive, frame = self.is_passive(sender), self.as_sent(frame, sender)
        if self._is_acknowledged is not None and not self._is_acknowledged(sender):
            return unacknowledged(frame, is_passive=is_passive)
        begin_ns, until_ns = ticks.whole_ns(start_ticks), ticks.whole_ns(end_ticks)
        self._stuck = [line for line in self._stuck if line.end_ns > begin_ns]
        if self._stuck and self._stuck[0].start_ns < until_ns:
            disturbed = _on_stuck_line(frame, self._stuck[0], start_ticks, ticks)
            if disturbed is not None:
                return disturbed
        first_ns, node = self._noise.first_hit_ns(begin_ns, until_ns), None
        for one, noise in self._noise_of.items():
            hit_ns = noise.first_hit_ns(begin_ns, until_ns)
            if (
                hit_ns is not None
                and (self.present is None or one in self.present)
                and not self.is_off(one)
                and (first_ns is None or hit_ns < first_ns)
            ):
                first_ns, node = hit_ns, one
        if first_ns is None:
            return None
        index = _bit_at(frame, first_ns * ticks.per_ns - start_ticks, ticks)
        if node is None:
            return disturb(frame, index, is_passive=is_passive)
        if node == sender:
            return disturb_sender(frame, index, is_passive=is_passive)
        self.join(node)
        # Its receive counter falls when it acknowledges: it is passive after that as a sender only.
        is_after_ack = frame_on_wire(frame)[index].field in AFTER_ACK
        is_passive = self.is_passive(node)
        if is_passive and is_after_ack:
            is_passive = self.counters(node).transmit >= PASSIVE_MIN
        return disturb_receiver(frame, index, node, is_passive=is_passive)

    def on_whole(self, sender: int) -> None:
        """Count a frame that was sent and received."""
        self.sent[sender] += 1
        if not self.is_calm:
            for node in tuple(self._limited):
                self.note_limits(node)

    def on_disturbed(self, disturbed: Disturbed, sender: int, frame: Frame, time_ns: int) -> None:
        """Count a disturbed transmission and report it."""
        if not disturbed.is_repeated:
            self.sent[sender] += 1
            if disturbed.only_at is not None:
                self._members[disturbed.only_at].all_frames += 1  # which it has not received
        total = self._all_frames
        own = self._up_to_date(sender, total).counters
        before = own.state
        for node in self._members:
            counters = self._up_to_date(node, total).counters
            _count(counters, disturbed, is_sender=node == sender, is_odd=node == disturbed.only_at)
            if counters.is_passive or node in self._limited:
                self.note_limits(node)
        self.causes[disturbed.cause] += 1
        self.received_twice += disturbed.is_received and disturbed.is_repeated
        self.missed_by_one += disturbed.is_received and disturbed.only_at is not None
        state = own.state
        self.bus_offs += state is ControllerState.BUS_OFF
        if self.on_error is not None:
            event = ErrorEvent(
                time_ns,
                sender,
                frame,
                disturbed.cause,
                disturbed.field,
                own.transmit,
                own.receive,
                state,
                state is not before,
                disturbed.is_repeated,
            )
            self.on_error(event)

    def note_limits(self, node: int) -> None:
        """Look at a node's counters again after they have been changed."""
        if self.counters(node).is_passive:
            self._limited.add(node)
        else:
            self._limited.discard(node)
        self.is_calm = not self._limited

    @property
    def _all_frames(self) -> int:
        return sum(self.sent.values())

    def _up_to_date(self, node: int, total: int) -> _Member:
        """Let the counters of a node see the frames that have come through since last time."""
        member = self._members[node]
        own = self.sent[node]
        new_own = own - member.own_frames
        new_others = total - member.all_frames - new_own
        member.own_frames, member.all_frames = own, total
        if member.counters.transmit < BUS_OFF_MIN:
            member.counters.on_sent(new_own)
            member.counters.on_received(new_others)
        return member


def _on_stuck_line(
    frame: Frame, line: StuckLine, start_ticks: int, ticks: BitTicks
) -> Disturbed | None:
    from_ticks, to_ticks = line.start_ns * ticks.per_ns, line.end_ns * ticks.per_ns
    first = -1
    if from_ticks > start_ticks:
        first = _bit_at(frame, from_ticks - start_ticks, ticks)
    left_ticks = to_ticks - max(from_ticks, start_ticks)
    return disturb_stuck(frame, line.level, first, -(-left_ticks // ticks.nominal) - min(first, 0))


def _bit_at(frame: Frame, offset_ticks: int, ticks: BitTicks) -> int:
    """Index of the bit that is on the wire so long after the start of frame, before its end."""
    if not frame.flags & BITRATE_SWITCH:
        return offset_ticks // ticks.nominal
    # Noise is rare, so this is too.
    lengths = (ticks.data if bit.is_fast else ticks.nominal for bit in frame_on_wire(frame))
    return sum(end_ticks <= offset_ticks for end_ticks in accumulate(lengths))


def _count(counters: ErrorCounters, disturbed: Disturbed, *, is_sender: bool, is_odd: bool) -> None:
    """Let one node count a disturbed transmission; ``is_odd`` if it alone saw the error."""
    if is_sender and disturbed.is_transmit_error:
        counters.on_transmit_error(1 + disturbed.again)
        return
    counted = disturbed.counted
    errors = counted.sender if is_sender else counted.odd if is_odd else counted.receivers
    is_acknowledged = disturbed.field in AFTER_ACK if is_odd else disturbed.is_acknowledged
    is_whole = is_acknowledged or (disturbed.is_received and not errors)
    # What is not repeated has been counted as a frame by all but the odd one.
    if not is_sender and (is_whole if disturbed.is_repeated else is_odd and is_acknowledged):
        counters.on_received()
    if errors:
        counters.on_receive_error()
        for _ in range(min(disturbed.again, PASSIVE_MIN) + (errors == FIRST)):
            counters.on_dominant_after_flag()
