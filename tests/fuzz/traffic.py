"""Reads decisions from the bytes that a fuzzer has made, and makes the traffic of a node of them.

Decisions are numbers, choices, words, payloads; traffic is frames of every kind, from noise to
faultless ones, at any times. Most frames under the identifiers of the contract are given the
counter and the CRC that they need, because noise does not pass a CRC.
"""

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import TypeVar

from steer_by_wire.dbc.codec.protection import COUNTERS, protect
from steer_by_wire.dbc.messages import CAN_IDS, DisturbanceConfig, LatencyConfig, Message
from steer_by_wire.runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S

T = TypeVar("T")

TELLING_NUMBERS = (
    0.0, -0.0, 1.0, -1.0, 0.5, 1e-9, -1e-9, 5e-324, 1e-300, 1e300, 1.7976931348623157e308,
    math.inf, -math.inf, math.nan, 100.0, 1e6, 1e9, 9007199254740993.0, 0.1, 10.0,
)  # fmt: skip
"""Values at which arithmetic is most likely to fail."""


class Choices:
    """Decisions from ``data``, front to back."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._place = 0

    @property
    def exhausted(self) -> bool:
        """Whether all bytes have been used."""
        return self._place >= len(self._data)

    def integer(self, low: int, high: int) -> int:
        """Return a whole number from ``low`` to ``high``, both included."""
        width = (high - low).bit_length() + 7 >> 3
        return low + int.from_bytes(self.raw(width), "little") % (high - low + 1)

    def pick(self, options: Sequence[T]) -> T:
        """Return one of ``options``, which are not empty."""
        return options[self.integer(0, len(options) - 1)]

    def chance(self, of_256: int) -> bool:
        """Return True for ``of_256`` of the values of a byte; False at the end of the data."""
        return self.integer(0, 255) >= 256 - of_256

    def raw(self, size: int) -> bytes:
        """Return the next ``size`` bytes, zeros at the end of the data."""
        taken = self._data[self._place : self._place + size]
        self._place += size
        return taken.ljust(size, b"\0")

    def rest(self) -> bytes:
        """Return all bytes that are left."""
        taken, self._place = self._data[self._place :], len(self._data)
        return taken

    def number(self) -> float:
        """Return any float: a critical one, a short one, or eight bytes of IEEE 754."""
        kind = self.integer(0, 3)
        if kind == 0:
            return self.pick(TELLING_NUMBERS)
        if kind == 1:
            return float(self.integer(-1000, 1000))
        if kind == 2:
            return self.integer(-9999, 9999) * 10.0 ** self.integer(-12, 12)
        return float(struct.unpack("<d", self.raw(8))[0])

    def text(self, length_max: int = 20) -> str:
        """Return any text, as the command line has it: bytes that are no UTF-8 are surrogates."""
        raw = self.raw(self.integer(0, length_max))
        return raw.decode("utf-8", errors="surrogateescape")


STALL_NS_MAX = 60 * NS_PER_S
"""Longest time between two wake-ups of a node."""
EVENTS_MAX = 400
"""Wake-ups from one input, which bounds the time it takes."""
BY_HAND = (LatencyConfig, DisturbanceConfig)
"""What a tool sends, of seven bytes without counter and CRC."""
DATA_IDS: Mapping[type[Message], int] = {
    message_type: 0x5000 | can_id
    for message_type, can_id in CAN_IDS.items()
    if message_type not in BY_HAND
}
"""As the wire contract lists them; stated here anew, as another sender would."""
_OUR_IDS = tuple(CAN_IDS.values())
_ALL_FLAGS = EXTENDED | REMOTE | ERROR | FD | BITRATE_SWITCH
_LENGTHS = (8, 7, 0, 1, 2, 3, 6, 9, 12, 16, 48, 63, 64)


class Sender:
    """Another sender, which knows the contract and keeps to it only at times."""

    def __init__(self) -> None:
        self._counters = dict.fromkeys(DATA_IDS, 0)

    def frame(self, choices: Choices) -> Frame:
        """Return any frame; four in eight are faultless up to their signals."""
        kind = choices.integer(0, 7)
        if kind < 4:
            return self._protected(choices)
        if kind == 4:
            return Frame(CAN_IDS[choices.pick(BY_HAND)], choices.raw(7))
        if kind == 5:  # faultless except for what a gateway or an adapter may make of it
            frame = self._protected(choices)
            return frame._replace(flags=choices.integer(0, _ALL_FLAGS))
        if kind == 6:  # an error of a few bits
            frame = self._protected(choices)
            flip = 1 << choices.integer(0, 63) | 1 << choices.integer(0, 63)
            return frame._replace(data=(int.from_bytes(frame.data) ^ flip).to_bytes(8))
        can_id = choices.pick(_OUR_IDS) if choices.chance(192) else choices.integer(0, 2**29 - 1)
        return Frame(can_id, choices.raw(choices.pick(_LENGTHS)), choices.integer(0, _ALL_FLAGS))

    def _protected(self, choices: Choices) -> Frame:
        """Return a frame whose CRC holds; its counter mostly steps by one."""
        message_type = choices.pick(tuple(DATA_IDS))
        step = 1 if choices.chance(224) else choices.integer(0, COUNTERS - 1)
        counter = (self._counters[message_type] + step) % COUNTERS
        self._counters[message_type] = counter
        payload = bytearray(b"\0\0" + bytes([counter]) + choices.raw(5))
        protect(payload, DATA_IDS[message_type])
        return Frame(CAN_IDS[message_type], bytes(payload))


def wake_ups(choices: Choices) -> Iterator[tuple[int, Sequence[Frame]]]:
    """Yield a node's wake-ups: the time, which never runs backwards [ns], and what has come."""
    sender = Sender()
    now_ns = 0
    for _ in range(EVENTS_MAX):
        if choices.exhausted:
            return
        now_ns += _step_ns(choices)
        yield now_ns, [sender.frame(choices) for _ in range(choices.integer(0, 3))]


def _step_ns(choices: Choices) -> int:
    """Return the time to the next wake-up: mostly about a period, sometimes none, or a stall."""
    kind = choices.integer(0, 15)
    if kind < 8:
        return 10 * NS_PER_MS
    if kind < 12:
        return choices.integer(0, 20 * NS_PER_MS)
    if kind < 14:
        return choices.integer(0, 3)
    if kind == 14:
        return choices.integer(0, 2 * NS_PER_S)
    # One input cannot have many of the longest, or it would take minutes to compute the motion.
    return choices.integer(0, STALL_NS_MAX) if choices.chance(4) else 200 * NS_PER_MS
