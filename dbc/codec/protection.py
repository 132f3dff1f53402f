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
from typing import NamedTuple

COUNTERS = 256
"""Number of values of the counter, which wraps."""
HALF = COUNTERS // 2
"""A counter this far ahead or further is taken for an older one."""
HEADER_BYTES = 3
PERIOD_NS_MIN = 1_000_000
"""Shortest period of any message [ns]."""
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


def mark_in(payload: bytes) -> int:
    """Return the ``id_mark`` of the Data ID under which ``payload`` (3 bytes or more) is intact."""
    return (payload[0] | payload[1] << 8) ^ _crc(payload, 0)


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
    """Newer by more than the time that has passed explains."""
    DISPUTED = "disputed"
    """Two senders, and nobody can know which is the true one."""


_ACCEPTED = SequenceResult.ACCEPTED
_NONE = -1
"""No counter."""


class SequenceRule(NamedTuple):
    """What a receiver believes of counters.

    ``lead_ns``     how much earlier than by the time since the newest accepted frame one may come:
                    the spread of the network's latency, 0 or more [ns]
    ``resync_run``  refused frames in a row that show another stream of counters, 1 or more
    ``resync_ns``   silence after which a restart of the sender is believed, 0 or more [ns]; 0 for a
                    receiver that does not act on the message
    """

    lead_ns: int
    resync_run: int
    resync_ns: int = 0

    def step_max(self, period_ns: int, elapsed_ns: int) -> int:
        """Return the largest step of a counter that is believed after ``elapsed_ns``."""
        return min(1 + (self.lead_ns + elapsed_ns) // period_ns, HALF - 1)


class SequenceCheck:
    """Checks the counters of one message as they arrive: the newest wins.

    The first frame is accepted. After that a frame is accepted if its counter is 1 to
    ``SequenceRule.step_max`` ahead of the newest accepted one (modulo 256): no sender's counter
    runs faster than time, but for the frames that a varying latency lets overtake others.

    **Restart.** A sender that restarted, or was silent for long, may continue from any counter.
    After ``resync_run`` refused frames in a row whose counters step by exactly one, the next that
    steps by one is accepted, but not before ``resync_ns`` have passed since the newest accepted
    frame. If this is no shorter than the time after which the receiver stops acting on that frame,
    it always holds before it changes from one stream of counters to another.

    **Second sender.** A sender never uses a counter for two contents. ``resync_run`` refused frames
    that step by one and each contradict an accepted frame, or are too far ahead, while others are
    accepted, come from a second sender. If it is no further behind than the accepted stream has
    stepped ahead lately, that stream may be the false one. Then neither is accepted (DISPUTED)
    until one of them is alone, which is found as a restart is.

    ``period_ns``  of the sender; a shorter one is measured, each time its counters wrap [ns]

    ``counter``           of the newest accepted frame, 0 before the first
    ``arrival_ns``        when that arrived, None before the first [ns]
    ``lost``              counters skipped by accepted frames. A late frame is refused and stays
                          counted; frames skipped by a resynchronisation are unknown and not counted
    ``resynchronised``    how often a run of refused frames was accepted as a restart of the sender
    ``disputes``          how often neither of two senders could be believed
    ``second_sender_ns``  when a frame of a second sender was last noticed, None for never [ns]
    """

    def __init__(self, rule: SequenceRule, period_ns: int) -> None:
        for name, value, least in zip(SequenceRule._fields, rule, (0, 1, 0), strict=True):
            if value < least:
                raise ValueError(f"{name} = {value}: allowed is {least} or more")
        self._rule = rule
        self._period_ns_max = self._period_ns = max(period_ns, PERIOD_NS_MIN)
        self._next = _NONE
        self._is_disputed = False
        self._contents: list[object] = []
        self._wrapped_ns = self._wrapped_at = 0
        self._longest_step = self._longest_before = 1
        self._last_refused = _NONE
        self._run = 0
        self._last_foreign = _NONE
        self._foreign_run = 0
        self._foreign_since_ns = 0
        self.counter = 0
        self.arrival_ns: int | None = None
        self.lost = 0
        self.resynchronised = 0
        self.disputes = 0
        self.second_sender_ns: int | None = None

    def check(self, counter: int, now_ns: int = 0, content: object = b"") -> SequenceResult:
        """Check the frame that carries ``counter`` (0 to 255) and arrives at ``now_ns``.

        ``content``  what identifies the frame, its payload for instance
        """
        if counter == self._next:  # nearly all frames; not after 255, so that a wrap is noticed
            self.counter, self.arrival_ns, self._run = counter, now_ns, 0
            self._next = counter + 1
            self._contents[counter] = content
            return _ACCEPTED
        before_ns = self.arrival_ns
        if before_ns is None:
            return self._start(counter, now_ns, content)
        forward = (counter - self.counter) % COUNTERS
        step_max = self._rule.step_max(self._period_ns, now_ns - before_ns)
        if 1 <= forward <= step_max and not self._is_disputed:
            return self._skip(counter, forward, now_ns, content)
        return self._refuse(counter, forward, now_ns, content, now_ns - before_ns)

    def undisputed(self) -> object | None:
        """Return the content of the last frame that only the true sender can have sent, if known.

        To be asked for when a dispute begins.
        """
        newest = self.counter - self._longest_lately - self._rule.resync_run
        for counter in range(newest, newest - HALF, -1):
            if self._contents[counter % COUNTERS] is not None:
                return self._contents[counter % COUNTERS]
        return None

    @property
    def _longest_lately(self) -> int:
        """The longest accepted step since the counter has wrapped twice."""
        return max(self._longest_step, self._longest_before)

    def _start(self, counter: int, now_ns: int, content: object) -> SequenceResult:
        """Accept the first frame of a stream of counters."""
        self._contents = [None] * COUNTERS
        self._wrapped_ns, self._wrapped_at = now_ns, counter
        self._longest_step = self._longest_before = 1
        self._is_disputed = False
        self._foreign_run = 0
        return self._accept(counter, now_ns, content)

    def _skip(self, counter: int, forward: int, now_ns: int, content: object) -> SequenceResult:
        """Accept a frame after which the counters go on elsewhere than at the next."""
        for skipped in range(self.counter + 1, self.counter + forward):
            self._contents[skipped % COUNTERS] = None
        self.lost += forward - 1
        self._longest_step = max(self._longest_step, forward)
        if counter < self.counter:
            measured_ns = (now_ns - self._wrapped_ns) // (COUNTERS - self._wrapped_at + counter)
            self._period_ns = min(max(measured_ns, PERIOD_NS_MIN), self._period_ns_max)
            self._wrapped_ns, self._wrapped_at = now_ns, counter
            self._longest_before, self._longest_step = self._longest_step, 1
        return self._accept(counter, now_ns, content)

    def _accept(self, counter: int, now_ns: int, content: object) -> SequenceResult:
        self.counter, self.arrival_ns, self._run = counter, now_ns, 0
        self._next = counter + 1
        self._contents[counter] = content
        return _ACCEPTED

    def _refuse(
        self, counter: int, forward: int, now_ns: int, content: object, silence_ns: int
    ) -> SequenceResult:
        """Refuse a frame, unless it shows that the sender has restarted."""
        steps_by_one = counter == (self._last_refused + 1) % COUNTERS and self._run > 0
        is_silent = silence_ns >= self._rule.resync_ns
        if steps_by_one and is_silent and self._run >= self._rule.resync_run:
            self.resynchronised += 1
            return self._start(counter, now_ns, content)
        self._run = self._run + 1 if steps_by_one else 1
        self._last_refused = counter
        if self._is_disputed:
            self.second_sender_ns = now_ns
            return SequenceResult.DISPUTED
        self._note_foreign(counter, forward, now_ns, content)
        if forward == 0:
            return SequenceResult.REPEATED
        return SequenceResult.TOO_FAR if forward < HALF else SequenceResult.OUT_OF_ORDER

    def _note_foreign(self, counter: int, forward: int, now_ns: int, content: object) -> None:
        """Look for a second sender in a refused frame; one that is late or doubled shows none."""
        known = self._contents[counter]
        is_ahead = 0 < forward < HALF
        if not is_ahead and (known is None or known == content):
            return
        if counter == (self._last_foreign + 1) % COUNTERS and self._foreign_run:
            self._foreign_run += 1
        else:
            self._foreign_run, self._foreign_since_ns = 1, now_ns
        self._last_foreign = counter
        # Without an accepted frame in between it is the only sender, started anew.
        is_second = (self.arrival_ns or 0) > self._foreign_since_ns
        if self._foreign_run >= self._rule.resync_run and is_second:
            self.second_sender_ns = now_ns
            if -forward % COUNTERS < self._longest_lately:
                self.disputes += 1
                self._is_disputed = True
                self._next = _NONE
