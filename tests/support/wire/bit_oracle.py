"""CAN nodes on a wire, one bit at a time, by tables: an oracle written apart from the model.

Nothing of the package is used but the bits of a frame. Each node sees the wire (dominant if anyone
is), with its own errors on top. What a node does next is in ``RULES``: a row for its state and what
it has just seen. What a receiver reads next is in ``FIELDS``: a row for the field that has ended.
It removes stuff bits and finds lengths and formats from the bits alone, right or wrong.

Source: ISO 11898-1:2015. A recessive res bit is another format: the node neither signals nor counts
an error, and takes part again after eleven recessive bits. The last three of these, as those after
an error delimiter, are the intermission, and are not counted here.

A recessive stuff bit before RTR that is seen dominant is no transmit error. A node that is error
passive signals by recessive bits, which nobody hears, until it has seen six equal bits in a row. If
it misses an acknowledgement it counts that only where it sees a dominant bit in the meantime.
"""

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

FLAG, PASSIVE_FLAG, DELIMITER, SILENT = "flag", "passive flag", "delimiter", "silent"
SEND, LISTEN = "send", "listen"
MATCH, CLASH, STUFF, LOST, NO_ACK = "match", "clash", "stuff", "lost", "no ack"
GOOD, WRONG, OVERLOAD, OTHER_FORMAT = "good", "wrong", "overload", "other format"

RULES = {
    # state, seen: next state, transmit errors, receive errors
    (SEND, MATCH): (SEND, 0, 0),
    (SEND, CLASH): (FLAG, 8, 0),
    (SEND, STUFF): (FLAG, 0, 0),
    (SEND, NO_ACK): (FLAG, 8, 0),
    (SEND, LOST): (LISTEN, 0, 0),
    (LISTEN, GOOD): (LISTEN, 0, 0),
    (LISTEN, WRONG): (FLAG, 0, 1),
    (LISTEN, OVERLOAD): (FLAG, 0, 0),
    (LISTEN, OTHER_FORMAT): (SILENT, 0, 0),
}
_POLYNOMIALS = {15: 0x4599, 17: 0x1685B, 21: 0x102899}
_FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
_RECESSIVE = (DELIMITER, SILENT)
_AFTER_BITS = 60
"""No error frame ends later than this after the frame."""


class Bit(NamedTuple):
    """A bit of the frame as it is sent.

    ``kind``  arbitration, stuff (a stuff bit before RTR), ack, or other
    """

    level: int
    kind: str


class Reader:
    """What a receiver has read of a frame.

    ``field``      that the next bit belongs to, and how many of its bits are ``left``
    ``kept``       bits without stuff bits, after a 1
    ``raw``        bits with them
    """

    def __init__(self) -> None:
        self.field, self.left, self.value = "SOF", 1, 0
        self.kept = self.raw = 1
        self.run, self.last, self.is_stuffed, self.stuff_bits = 0, 1, False, 0
        self.is_fd = self.is_remote = self.is_extended = self.is_damaged = self.accepted = False
        self.crc_bits = self.expected = 0

    @property
    def acknowledges(self) -> bool:
        """Whether the next bit is the slot, and all was right."""
        return self.field == "ACK" and not self.is_damaged

    def take(self, seen: int, sent: int) -> str:
        """Read a bit."""
        if self.is_stuffed:
            return self._take_stuffed(seen)
        if self.field == "check":
            return self._take_check(seen)
        if self.field == "SOF":
            if seen == 0:
                self.field, self.left, self.is_stuffed = "ID", 11, True
                self.kept, self.raw, self.run, self.last = 2, 2, 1, 0
            return GOOD
        return self._take_end(seen, sent)

    def _take_stuffed(self, seen: int) -> str:
        self.raw = self.raw << 1 | seen
        if self.run == 5:
            if seen == self.last:
                return WRONG
            self.run, self.last, self.stuff_bits = 1, seen, self.stuff_bits + 1
            self.is_stuffed = self.field != "CRC delimiter"
            return GOOD
        self.run = self.run + 1 if seen == self.last else 1
        self.last = seen
        self.kept = self.kept << 1 | seen
        self.value = self.value << 1 | seen
        self.left -= 1
        if self.left == 0:
            ended, self.field, value, self.value = self.field, "", self.value, 0
            self.field, self.left = FIELDS[ended](self, value)
        return GOOD if self.field != "exception" else OTHER_FORMAT

    def _take_check(self, seen: int) -> str:
        """Stuff count and CRC of an FD frame, every fifth bit the complement of the one before."""
        before, self.last = self.last, seen
        position = self.crc_bits + 5 + self.crc_bits // 4 + 1 - self.left
        self.left -= 1
        if position % 5 == 0:
            return WRONG if seen == before else GOOD
        self.value = self.value << 1 | seen
        if self.left == 0:
            count, crc = self.value >> self.crc_bits, self.value & (1 << self.crc_bits) - 1
            gray = self.stuff_bits % 8 ^ self.stuff_bits % 8 >> 1
            start = 1 << self.crc_bits - 1
            right = _remainder(self.crc_bits, start, self.raw << 4 | count)
            self.is_damaged = (count, crc) != (gray << 1 | gray.bit_count() % 2, right)
            self.field, self.left = "CRC delimiter", 1
        return GOOD

    def _take_end(self, seen: int, sent: int) -> str:
        field = self.field
        if field == "ACK":
            self.field = "ACK delimiter"
            return WRONG if sent == 0 and seen == 1 else GOOD
        if field == "CRC delimiter":
            self.field = "ACK"
        elif field == "ACK delimiter":
            self.field, self.left = "EOF", 7
            if self.is_damaged:  # a CRC error is signalled after the delimiter
                return WRONG
        else:
            self.left -= 1
            if self.left <= 0:  # the last bit, and the intermission
                return GOOD if seen else OVERLOAD
            self.accepted |= self.left == 1 and seen == 1
        return GOOD if seen else WRONG


Next = tuple[str, int]


def _after_rtr(reader: Reader, value: int) -> Next:
    reader.is_remote = value == 1
    return ("format", 1) if reader.is_extended else ("IDE", 1)


def _after_ide(reader: Reader, value: int) -> Next:
    reader.is_extended = value == 1
    return ("extension", 18) if value else ("format", 1)


def _after_format(reader: Reader, value: int) -> Next:
    reader.is_fd = value == 1
    if value:
        return "res", 1
    return ("r0", 1) if reader.is_extended else ("DLC", 4)


def _after_dlc(reader: Reader, value: int) -> Next:
    length = _FD_LENGTHS[value] if reader.is_fd else min(value, 8)
    if reader.is_remote and not reader.is_fd:
        length = 0
    return ("data", 8 * length) if length else _after_data(reader, 0)


def _after_data(reader: Reader, _value: int) -> Next:
    if not reader.is_fd:
        reader.expected = _remainder(15, 0, reader.kept)
        return "CRC", 15
    payload = reader.kept.bit_length() - (42 if reader.is_extended else 23)
    reader.crc_bits = 17 if payload <= 8 * 16 else 21
    reader.is_stuffed = False
    return "check", reader.crc_bits + 5 + reader.crc_bits // 4 + 1


def _after_crc(reader: Reader, value: int) -> Next:
    reader.is_damaged = value != reader.expected
    reader.is_stuffed = reader.run == 5
    return "CRC delimiter", 1


FIELDS: dict[str, Callable[[Reader, int], Next]] = {
    "ID": lambda _, __: ("RTR", 1),
    "RTR": _after_rtr,
    "IDE": _after_ide,
    "extension": lambda _, __: ("RTR", 1),
    "format": _after_format,
    "r0": lambda _, __: ("DLC", 4),
    "res": lambda _, value: ("exception", 0) if value else ("BRS", 1),
    "BRS": lambda _, __: ("ESI", 1),
    "ESI": lambda _, __: ("DLC", 4),
    "DLC": _after_dlc,
    "data": _after_data,
    "CRC": _after_crc,
}


def _remainder(width: int, start: int, bits: int) -> int:
    """CRC of the bits after the leading 1."""
    register, polynomial = start, _POLYNOMIALS[width]
    for level in bin(bits)[3:]:
        feedback = (level == "1") ^ register >> width - 1
        register = (register << 1 & (1 << width) - 1) ^ (polynomial if feedback else 0)
    return register


class Node:
    """A controller during one transmission.

    ``is_passive``  it is error passive
    """

    def __init__(self, state: str) -> None:
        self.state, self.is_sender = state, state == SEND
        self.is_passive, self.uncounted, self.last = False, 0, -1
        self.reader = Reader()
        self.transmit_errors = self.receive_errors = self.count = 0
        self.sent = self.is_first = False

    @property
    def is_over(self) -> bool:
        """Whether it only waits for recessive bits: of the delimiter, or after the frame."""
        unseen = self.reader.field == "SOF" or self.reader.left < 0
        return self.state in _RECESSIVE or (self.state == LISTEN and unseen)

    def copy(self) -> "Node":
        """Return another of the same state."""
        node, reader = object.__new__(Node), object.__new__(Reader)
        node.__dict__ = {**self.__dict__, "reader": reader}
        reader.__dict__ = dict(self.reader.__dict__)
        return node

    def level(self, bits: Sequence[Bit], index: int) -> int:
        """What the node sends."""
        if self.state == FLAG:
            return 0
        if self.state == SEND:
            return 1 if bits[index].kind == "ack" else bits[index].level
        if self.state == LISTEN and not self.is_sender:
            return 0 if self.reader.acknowledges else 1
        return 1

    def step(self, bits: Sequence[Bit], index: int, sent: int, seen: int) -> None:
        """Take what the node saw while it sent."""
        if self.state == FLAG:
            self.count += 1
            if self.count == 6:
                self.state, self.count, self.is_first = DELIMITER, 0, True
        elif self.state == PASSIVE_FLAG:
            if seen == 0:
                self.transmit_errors += self.uncounted
                self.uncounted = 0
            self.count = self.count + 1 if seen == self.last else 1
            self.last = seen
            if self.count == 6:
                self.state, self.count, self.is_first = DELIMITER, 0, True
        elif self.state in _RECESSIVE:
            if seen == 0 and self.is_first and not self.is_sender:
                self.receive_errors += 8  # a dominant bit right after one's own flag
            self.is_first = False
            self.count = self.count + 1 if seen else 0  # of eight, and the intermission
        else:
            saw = self.reader.take(seen, sent)
            if self.state == SEND:
                saw = _sender_saw(bits[index].kind, sent, seen)
            self.state, transmit, receive = RULES[self.state, saw]
            if self.state == FLAG and self.is_passive and saw != OVERLOAD:
                self.state = PASSIVE_FLAG
                if saw == NO_ACK:
                    self.uncounted, transmit = transmit, 0
            self.transmit_errors += transmit
            self.receive_errors += receive
            self.sent = self.state == SEND and index == len(bits) - 1


def _sender_saw(kind: str, sent: int, seen: int) -> str:
    if kind == "ack":
        return MATCH if seen == 0 else NO_ACK
    if seen == sent:
        return MATCH
    if sent == 0:
        return CLASH
    return {"arbitration": LOST, "stuff": STUFF}.get(kind, CLASH)


class Wire:
    """Node 0 sends a frame to two others; all begins again at any of its bits."""

    def __init__(self, bits: Sequence[Bit]) -> None:
        self._bits = bits
        self._before: list[list[Node]] = []
        nodes = [Node(SEND), Node(LISTEN), Node(LISTEN)]
        for index in range(len(bits)):
            self._before.append([node.copy() for node in nodes])
            self._step(nodes, index, ())
        assert nodes[0].sent
        assert all(node.reader.accepted for node in nodes[1:])

    def transmit(
        self, index: int, wrong_at: Collection[int], passive: int | None = None
    ) -> tuple[list[Node], int]:
        """Return the nodes and the bits it took when some nodes see bit ``index`` wrong.

        ``wrong_at``  all, or one of them; receivers that see the same are the same
        ``passive``   the node that is error passive, if one is: 0, or the one of ``wrong_at``
        """
        members = [0, 1, 2] if 2 in wrong_at and 1 not in wrong_at else [0, 1]
        nodes = [self._before[index][number].copy() for number in members]
        for number, node in zip(members, nodes, strict=True):
            node.is_passive = number == passive
        self._step(nodes, index, wrong_at)
        last = len(self._bits) - 1
        while not nodes[0].sent and index < last + _AFTER_BITS:
            if all(node.is_over for node in nodes):
                index += max(8 - node.count for node in nodes if node.state in _RECESSIVE)
                break
            index += 1
            self._step(nodes, index, ())
        return [*nodes, *nodes[1:]][:3], index + 1

    def _step(self, nodes: list[Node], index: int, wrong_at: Collection[int]) -> None:
        levels = [node.level(self._bits, index) for node in nodes]
        wire = min(levels)
        for number, node in enumerate(nodes):
            node.step(self._bits, index, levels[number], wire ^ (number in wrong_at))
