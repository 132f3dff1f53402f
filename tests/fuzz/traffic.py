"""Drawn numbers, texts and bytes, and the drawn traffic of a node.

Traffic is frames of every kind, from noise to faultless ones, at any times. Most frames under the
identifiers of the contract are given the counter and the CRC that they need, because noise does not
pass a CRC.
"""

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from random import Random

from steer_by_wire.dbc.codec.protection import COUNTERS, protect
from steer_by_wire.dbc.messages import CAN_IDS, DisturbanceConfig, LatencyConfig, Message
from steer_by_wire.runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S

TELLING_NUMBERS = (
    0.0, -0.0, 1.0, -1.0, 0.5, 1e-9, -1e-9, 5e-324, 1e-300, 1e300, 1.7976931348623157e308,
    math.inf, -math.inf, math.nan, 100.0, 1e6, 1e9, 9007199254740993.0, 0.1, 10.0,
)  # fmt: skip
"""Values at which arithmetic is most likely to fail."""


def number_of(rng: Random) -> float:
    """Return any float: a critical one, a short one, or eight bytes of IEEE 754."""
    kind = rng.randint(0, 4)
    if kind == 0:
        return rng.choice(TELLING_NUMBERS)
    if kind == 4:
        return rng.uniform(0.0, 2.0)
    if kind == 1:
        return float(rng.randint(-1000, 1000))
    if kind == 2:
        return rng.randint(-9999, 9999) * 10.0 ** rng.randint(-12, 12)
    return float(struct.unpack("<d", rng.randbytes(8))[0])


def text_of(rng: Random, length_max: int = 20) -> str:
    """Return any text, as the command line has it: bytes that are no UTF-8 are surrogates."""
    raw = rng.randbytes(rng.randint(0, length_max))
    return raw.decode("utf-8", errors="surrogateescape")


def noise_of(rng: Random) -> bytes:
    """Return up to 300 bytes."""
    return rng.randbytes(rng.randint(0, 300))


STALL_NS_MAX = 60 * NS_PER_S
"""Longest time between two wake-ups of a node."""
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

    def frame(self, rng: Random) -> Frame:
        """Return any frame; four in eight are faultless up to their signals."""
        kind = rng.randint(0, 7)
        if kind < 4:
            return self._protected(rng)
        if kind == 4:
            return Frame(CAN_IDS[rng.choice(BY_HAND)], rng.randbytes(7))
        if kind == 5:  # faultless except for what a gateway or an adapter may make of it
            frame = self._protected(rng)
            return frame._replace(flags=rng.randint(0, _ALL_FLAGS))
        if kind == 6:  # an error of a few bits
            frame = self._protected(rng)
            flip = 1 << rng.randint(0, 63) | 1 << rng.randint(0, 63)
            return frame._replace(data=(int.from_bytes(frame.data) ^ flip).to_bytes(8))
        can_id = rng.choice(_OUR_IDS) if rng.random() < 0.75 else rng.randint(0, 2**29 - 1)
        return Frame(can_id, rng.randbytes(rng.choice(_LENGTHS)), rng.randint(0, _ALL_FLAGS))

    def _protected(self, rng: Random) -> Frame:
        """Return a frame whose CRC holds; its counter mostly steps by one."""
        message_type = rng.choice(tuple(DATA_IDS))
        step = 1 if rng.random() < 0.9 else rng.randint(0, COUNTERS - 1)
        counter = (self._counters[message_type] + step) % COUNTERS
        self._counters[message_type] = counter
        payload = bytearray(b"\0\0" + bytes([counter]) + rng.randbytes(5))
        protect(payload, DATA_IDS[message_type])
        return Frame(CAN_IDS[message_type], bytes(payload))


def wake_ups(rng: Random) -> Iterator[tuple[int, Sequence[Frame]]]:
    """Yield a node's wake-ups: the time, which never runs backwards [ns], and what has come."""
    sender = Sender()
    now_ns = 0
    for _ in range(rng.choice((3, 30, 100))):
        now_ns += _step_ns(rng)
        yield now_ns, [sender.frame(rng) for _ in range(rng.randint(0, 3))]


def _step_ns(rng: Random) -> int:
    """Return the time to the next wake-up: mostly about a period, sometimes none, or a stall."""
    kind = rng.randint(0, 15)
    if kind < 8:
        return 10 * NS_PER_MS
    if kind < 12:
        return rng.randint(0, 20 * NS_PER_MS)
    if kind < 14:
        return rng.randint(0, 3)
    if kind == 14:
        return rng.randint(0, 2 * NS_PER_S)
    # One input cannot have many of the longest, or it would take minutes to compute the motion.
    return rng.randint(0, STALL_NS_MAX) if rng.random() < 0.02 else 200 * NS_PER_MS
