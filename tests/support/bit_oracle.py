"""CAN nodes on a wire, one bit at a time, by tables: an oracle written apart from the model.

Nothing of the package is used but the bits of a frame. Each node sees the wire (dominant if anyone
is), with its own errors on top. What a node does next is in ``RULES``: a row for its state and what
it has just seen. Receivers remove stuff bits themselves, but know from the sender how many bits
there are, so that the oracle covers bits whose error does not change that: all but SRR, RTR, IDE,
FDF, res, BRS and DLC.
"""

from collections.abc import Collection, Sequence
from itertools import accumulate
from typing import NamedTuple

FLAG, DELIMITER, DONE = "flag", "delimiter", "done"
SEND, LISTEN = "send", "listen"
MATCH, CLASH, LOST, NO_ACK = "match", "clash", "lost", "no ack"
GOOD, WRONG, OVERLOAD = "good", "wrong", "overload"

RULES = {
    # state, seen: next state, transmit errors, receive errors
    (SEND, MATCH): (SEND, 0, 0),
    (SEND, CLASH): (FLAG, 8, 0),
    (SEND, NO_ACK): (FLAG, 8, 0),
    (SEND, LOST): (LISTEN, 0, 0),
    (LISTEN, GOOD): (LISTEN, 0, 0),
    (LISTEN, WRONG): (FLAG, 0, 1),
    (LISTEN, OVERLOAD): (FLAG, 0, 0),
}


class Bit(NamedTuple):
    """A bit of the frame as it is sent.

    ``kind``  arbitration, stuff, body, with stuff bits in between; then check, fixed (fixed stuff
              bits), ack, end (delimiters and end of frame)
    """

    level: int
    kind: str


class Layout:
    """A frame: the part with stuff bits in between, without them, and the rest."""

    def __init__(self, bits: Sequence[Bit]) -> None:
        self.bits = bits
        body = [bit for bit in bits if bit.kind in ("arbitration", "body", "stuff")]
        self.stuffed = [bit.level for bit in body if bit.kind != "stuff"]
        self.before = list(accumulate((bit.kind != "stuff" for bit in bits), initial=0))
        self.tail = bits[len(body) :]
        self.ack = next(i for i, bit in enumerate(self.tail) if bit.kind == "ack")
        self.has_last_stuff_bit = self.tail[0].kind != "fixed"


class Node:
    """A controller during one transmission."""

    def __init__(self, state: str, is_passive: bool) -> None:
        self.state, self.is_passive = state, is_passive
        self.is_sender = state == SEND
        self.transmit_errors = self.receive_errors = 0
        self.accepted = self.sent = False
        self.run, self.last, self.is_damaged, self.position = 0, 1, False, 0
        self.count, self.has_flagged = 0, False
        self._in_tail = self._is_apart = False

    @property
    def is_shifted(self) -> bool:
        """Whether it took other bits for stuff bits, and on a real bus may read another length."""
        return self._is_apart and self._in_tail

    def level(self, layout: Layout, index: int) -> int:
        """What the node sends."""
        if self.state == FLAG:
            return 1 if self.is_passive else 0
        if self.state == SEND and index < len(layout.bits):
            return 1 if layout.bits[index].kind == "ack" else layout.bits[index].level
        if self.state == LISTEN and self._tail(layout) == layout.ack and not self.is_sender:
            return 1 if self.is_damaged else 0
        return 1

    def _tail(self, layout: Layout) -> int:
        """Which of the bits without stuff bits in between is next; below 0 before them."""
        pending = self.run == 5 and layout.has_last_stuff_bit
        return self.position - len(layout.stuffed) - (1 if pending and not self._in_tail else 0)

    def step(self, layout: Layout, index: int, sent: int, seen: int) -> None:
        """Take what the node saw while it sent."""
        if self.state == FLAG:
            self._flag()
        elif self.state == DELIMITER:
            self._delimit(seen)
        elif self.state in (SEND, LISTEN):
            verdict = self._sender_verdict if self.state == SEND else self._verdict
            state, transmit, receive = RULES[self.state, verdict(layout, index, sent, seen)]
            self.transmit_errors += transmit
            self.receive_errors += receive
            self.state, self.count = state, 0
            if self.state == SEND:
                self.sent = index == len(layout.bits) - 1

    def _sender_verdict(self, layout: Layout, index: int, sent: int, seen: int) -> str:
        kind = layout.bits[index].kind
        self._read(layout, index, seen)
        if kind == "ack":
            return MATCH if seen == 0 else NO_ACK
        if seen == sent:
            return MATCH
        return LOST if kind == "arbitration" and sent == 1 else CLASH

    def _read(self, layout: Layout, index: int, seen: int) -> bool:
        """Take a bit of the stuffed part; returns whether it is a sixth equal one."""
        before = self.run
        self.run = before + 1 if seen == self.last else 1
        self.last = seen
        if self.position < len(layout.stuffed):
            if before == 5:
                return self.run == 6
            self.is_damaged |= seen != layout.stuffed[self.position]
            self._is_apart |= layout.before[index] != self.position
            self.position += 1
            return False
        return False

    def _verdict(self, layout: Layout, index: int, sent: int, seen: int) -> str:
        if self.position < len(layout.stuffed):
            return WRONG if self._read(layout, index, seen) else GOOD
        before, previous = self.run, self.last
        self.run = before + 1 if seen == previous else 1
        self.last = seen
        if before == 5 and layout.has_last_stuff_bit and not self._in_tail:
            self._in_tail = True
            return WRONG if self.run == 6 else GOOD
        self._in_tail = True
        at = self.position - len(layout.stuffed)
        self._is_apart |= at != index - (len(layout.bits) - len(layout.tail))
        self.position += 1
        last = len(layout.tail) - 1
        if at >= last:
            return GOOD if seen else OVERLOAD
        kind = layout.tail[at].kind
        if kind == "fixed":
            return WRONG if seen == previous else GOOD
        if kind == "check":
            self.is_damaged |= seen != layout.tail[at].level
        if kind == "ack":
            return WRONG if sent == 0 and seen == 1 else GOOD
        if kind == "end" and seen == 0:
            return WRONG
        if at == last - 7 and self.is_damaged:  # a CRC error is signalled after the ACK delimiter
            return WRONG
        self.accepted |= at == last - 1 and not self.is_sender
        return GOOD

    def _flag(self) -> None:
        self.count += 1
        if self.count == 6:
            self.state, self.count, self.has_flagged = DELIMITER, 0, False

    def _delimit(self, seen: int) -> None:
        if seen == 0 and self.count == 0 and not self.has_flagged and not self.is_sender:
            self.receive_errors += 8  # a dominant bit right after one's own flag
        self.has_flagged = True
        self.count = self.count + 1 if seen else 0
        if self.count == 8:
            self.state = DONE


def transmit(
    bits: Sequence[Bit], passive: Collection[int], nodes: int, wrong: Collection[tuple[int, int]]
) -> tuple[list[Node], int]:
    """Send ``bits`` from node 0 to the others; returns the nodes and the bits it took.

    ``passive``  the error passive ones
    ``wrong``    node and index of every bit seen wrong
    """
    layout = Layout(bits)
    members = [Node(SEND if n == 0 else LISTEN, n in passive) for n in range(nodes)]
    for index in range(len(bits) + 60):
        levels = [node.level(layout, index) for node in members]
        wire = min(levels)
        for number, (node, sent) in enumerate(zip(members, levels, strict=True)):
            node.step(layout, index, sent, wire ^ ((number, index) in wrong))
        if members[0].sent and index >= len(bits) - 1 and members[0].state == SEND:
            return members, index + 1
        if all(node.state == DONE for node in members):
            return members, index + 1
    return members, len(bits) + 60
