"""End-to-end protection: AUTOSAR E2E profile 5 (CRC, counter).

A protected payload starts with the profile's header:

    bytes 0, 1   CRC-16 (polynomial 0x1021, start 0xFFFF), low byte first, over bytes 2 to the end
                 and then the Data ID, low byte first; the Data ID itself is not sent
    byte 2       counter, one more for each frame of the message, or one in its place; 255 is
                 followed by 0

The CRC detects corruption and, by the Data ID, a payload under the wrong identifier. In our frames
it detects every change of up to three bits, and others with probability 1 - 2**-16. The counter
detects loss, repetition and reordering. Neither detects a frame that is too old, because a frame
contains no time. The receiver must watch for the silence of a message itself. Which counters it
accepts is the rule of ``dbc.codec.counter_rule``.
"""

from binascii import crc_hqx
from collections.abc import Collection

COUNTERS = 256
"""Number of values of the counter, which wraps."""
HALF = COUNTERS // 2
"""A counter this far ahead or further is an older one."""
HEADER_BYTES = 3
START = 0xFFFF
"""Initial value of the CRC's register."""


def header_bits(message_name: str) -> dict[str, tuple[int, int]]:
    """Place of the profile's header in a message: signal name to (first bit, bits)."""
    return {f"{message_name}_CRC": (0, 16), f"{message_name}_COUNTER": (16, 8)}


def protect(payload: bytearray, data_id: int) -> None:
    """Write the CRC of ``payload`` (3 bytes or more, counter in byte 2) into bytes 0 and 1."""
    payload[:2] = _crc(payload, data_id).to_bytes(2, "little")


def id_mark(data_id: int) -> int:
    """Return what ``data_id`` adds to the CRC of any payload: the CRC is linear."""
    return crc_hqx(data_id.to_bytes(2, "little"), 0)


def is_masqueraded(payload: bytes, marks: Collection[int]) -> bool:
    """Whether a payload whose CRC is wrong is intact under a Data ID with one of ``marks``."""
    return mark_in(payload) in marks


def mark_in(payload: bytes) -> int:
    """Return the ``id_mark`` of the Data ID under which ``payload`` (3 bytes or more) is intact."""
    return (payload[0] | payload[1] << 8) ^ _crc(payload, 0)


def _crc(payload: bytes | bytearray, data_id: int) -> int:
    return crc_hqx(payload[2:] + data_id.to_bytes(2, "little"), START)
