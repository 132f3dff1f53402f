"""End-to-end protection: AUTOSAR E2E profile 5 (CRC, counter) and the check of received counters.

A protected payload starts with the profile's header:

    bytes 0, 1   CRC-16 (polynomial 0x1021, start 0xFFFF), low byte first, over bytes 2 to the end
                 and then the Data ID, low byte first; the Data ID itself is not sent
    byte 2       counter, one more for each frame of the message; 255 is followed by 0

The CRC detects corruption and, by the Data ID, a payload under the wrong identifier. In our frames
it detects every change of up to three bits, and others with probability 1 - 2**-16. The counter
detects loss, repetition and reordering. Neither detects a frame that is too old, because a frame
contains no time. The receiver must watch for the silence of a message itself.
"""

from binascii import crc_hqx
from enum import StrEnum

COUNTERS = 256
"""Number of values of the counter, which wraps."""
HEADER_BYTES = 3
START = 0xFFFF
"""Initial value of the CRC's register."""


def header_bits(message_name: str) -> dict[str, tuple[int, int]]:
    """Place of the profile's header in a message: signal name to (first bit, bits)."""
    return {f"{message_name}_CRC": (0, 16), f"{message_name}_COUNTER": (16, 8)}


def protect(payload: bytearray, data_id: int) -> None:
    """Write the CRC of ``payload`` (3 bytes or more, counter in byte 2) into bytes 0 and 1."""
    payload[:2] = _crc(payload, data_id).to_bytes(2, "little")


def is_intact(payload: bytes, data_id: int) -> bool:
    """Whether the CRC of ``payload`` (3 bytes or more) is that of its content and ``data_id``."""
    return _crc(payload, data_id) == payload[0] | payload[1] << 8


def _crc(payload: bytes | bytearray, data_id: int) -> int:
    return crc_hqx(payload[2:] + data_id.to_bytes(2, "little"), START)


class SequenceResult(StrEnum):
    """Verdict on a frame by its counter; only ACCEPTED frames are to be used."""

    ACCEPTED = "accepted"
    REPEATED = "repeated"
    """The counter of the newest accepted frame again."""
    OUT_OF_ORDER = "out_of_order"
    """Older than the newest accepted frame."""
    TOO_FAR = "too_far"
    """Newer by more than ``max_jump``."""


_ACCEPTED = SequenceResult.ACCEPTED


class SequenceCheck:
    """Checks the counters of one message as they arrive: the newest wins.

    The first frame is accepted. After that a frame is accepted if it is newer than the newest
    accepted one by 1 to ``max_jump`` (forward, modulo 256). A sender that restarted, or was silent
    for long, may continue from any counter: after ``resync_run`` refused frames in a row whose
    counters step by exactly one, the next that steps by one is accepted, but not before
    ``resync_ns`` have passed since the newest accepted frame. If this is no shorter than the time
    after which the receiver stops acting on that frame, it always holds before it changes from one
    stream of counters to another.

    ``max_jump``    1 to 127, so that newer and older by the same amount stay distinguishable
    ``resync_run``  1 or more
    ``resync_ns``   0 or more [ns]; 0 for a receiver that does not act on the message

    ``counter``         of the newest accepted frame, 0 before the first
    ``arrival_ns``      when that arrived, None before the first [ns]
    ``lost``            counters skipped by accepted frames. A late frame is refused and stays
                        counted; frames skipped by a resynchronisation are unknown and not counted
    ``resynchronised``  how often a run of refused frames was accepted as a restart of the sender
    """

    def __init__(self, max_jump: int, resync_run: int, resync_ns: int = 0) -> None:
        if not 1 <= max_jump <= COUNTERS // 2 - 1:
            raise ValueError(f"max_jump = {max_jump}: allowed is 1 to {COUNTERS // 2 - 1}")
        if resync_run < 1:
            raise ValueError(f"resync_run = {resync_run}: allowed is 1 or more")
        if resync_ns < 0:
            raise ValueError(f"resync_ns = {resync_ns}: allowed is 0 or more")
        self._max_jump = max_jump
        self._resync_run = resync_run
        self._resync_ns = resync_ns
        self._last_refused: int | None = None
        self._run = 0
        self.counter = 0
        self.arrival_ns: int | None = None
        self.lost = 0
        self.resynchronised = 0

    def check(self, counter: int, now_ns: int = 0) -> SequenceResult:
        """Check the frame that carries ``counter`` (0 to 255) and arrives at ``now_ns``."""
        if self.arrival_ns is None:
            return self._accept(counter, now_ns)
        forward = (counter - self.counter) % COUNTERS
        if 1 <= forward <= self._max_jump:
            # Written out, as nearly all frames pass here.
            self.lost += forward - 1
            self.counter, self.arrival_ns, self._run = counter, now_ns, 0
            return _ACCEPTED
        steps_by_one = self._last_refused == (counter - 1) % COUNTERS
        is_silent = now_ns - self.arrival_ns >= self._resync_ns
        if steps_by_one and is_silent and self._run >= self._resync_run:
            self.resynchronised += 1
            return self._accept(counter, now_ns)
        self._run = self._run + 1 if steps_by_one else 1
        self._last_refused = counter
        if forward == 0:
            return SequenceResult.REPEATED
        return SequenceResult.TOO_FAR if forward < COUNTERS // 2 else SequenceResult.OUT_OF_ORDER

    def _accept(self, counter: int, now_ns: int) -> SequenceResult:
        self.counter = counter
        self.arrival_ns = now_ns
        self._run = 0
        return _ACCEPTED
