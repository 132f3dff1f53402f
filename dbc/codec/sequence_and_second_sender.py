"""Which received counters of a message are believed, and what follows from two senders of it.

The newest wins. The first frame is accepted. After that a frame is accepted if its counter is 1 to
``SequenceRule.step_max`` ahead of the newest accepted one (modulo 256): no sender's counter runs
faster than time, but for the frames that a varying latency lets overtake others. Time counts from
when the newest one would have come, had it been as early as the earliest of the last HALF counters:
after a bus was held up, frames that waited in a buffer come late, and the next as early as before.
``tools/generate_c/node/sequence.c`` is the same rule in C, and changes with it.

**Restart.** A sender that restarted, or was silent for long, may continue from any counter. After
``resync_run`` refused frames in a row whose counters step by exactly one, the next that steps by
one is accepted, but not before ``resync_ns`` have passed since the newest accepted frame. If this
is no shorter than the time after which the receiver stops acting on that frame, it always holds
before it changes from one stream of counters to another.

**Contradiction.** A sender never uses a counter for two contents, and a network seldom lets a frame
overtake more than ``resync_run`` others that then come in a row. Either contradicts an accepted
frame: there are two senders or a new one, and nobody can know which of the two frames is true. So
neither is used. The receiver goes back to the newest frame that is too old to be forged, or the
first one, and is cautious until CAUTION_NS after the last contradiction.

**Caution.** A frame in sequence waits for WAIT_CYCLES of its sender, and is used when a further one
comes in sequence. By then the true sender has sent its next frame. If that is no newer than a frame
that waits, it contradicts it, and neither is used.

**Two streams.** ``resync_run`` frames of other counters within FOREIGN_NS, beside frames in
sequence, are a second sender, and so is each further one during the caution. For QUIET_NS after it
no frame is used, whoever came first. So whoever forges frames beside a sender whose frames arrive
is not followed: at most he keeps these from being used, which is silence. A late frame that fills a
gap is of the same stream, unless it comes so late that it would have been missed.
"""

from collections import deque
from enum import StrEnum
from itertools import pairwise
from statistics import median_low
from typing import NamedTuple

from .protection import COUNTERS

HALF = COUNTERS // 2
"""A counter this far ahead or further is taken for an older one."""
QUARTER = COUNTERS // 4
"""At most so many periods back a receiver goes, so that the next counters are no older ones."""
PERIOD_NS_MIN = 1_000_000
"""Shortest period of any message [ns]."""
CAUTION_NS = 10_000_000_000
"""How long a receiver is cautious after a contradiction [ns]."""
WAIT_CYCLES = 1.5
"""How long a frame waits during caution, in gaps between the frames of its sender."""
GAP_NS_MAX = 100_000_000
"""The longest cycle of any message, for a receiver to which no gap is silence [ns]."""
GAPS = 8
"""How many of them are measured; the longest counts."""
FOREIGN_NS = 1_000_000_000
"""In which frames of another stream are counted [ns]."""
QUIET_NS = 100_000_000
"""How long nobody is followed after a frame of a second sender [ns]."""


class SequenceResult(StrEnum):
    """Verdict on a frame by its counter."""

    ACCEPTED = "accepted"
    """To be used."""
    CONFIRMED = "confirmed"
    """It waits, and the frame that now is in use has waited long enough."""
    TAKEN_BACK = "taken_back"
    """It contradicts the frame in use; the one before is in use again."""
    WAITING = "waiting"
    """In sequence, but a contradiction may still come."""
    CONTRADICTED = "contradicted"
    """It contradicts a frame that is no longer in use, or not yet."""
    REPEATED = "repeated"
    """The counter of the newest frame again."""
    OUT_OF_ORDER = "out_of_order"
    """Older than the newest frame."""
    TOO_FAR = "too_far"
    """Newer by more than the time that has passed explains."""


_ACCEPTED, _CONTRADICTED = SequenceResult.ACCEPTED, SequenceResult.CONTRADICTED
CHANGING = frozenset((_ACCEPTED, SequenceResult.CONFIRMED, SequenceResult.TAKEN_BACK))
"""Results after which another frame is in use than before."""
_NONE = -1
"""No counter."""
_SKIPPED = object()
"""In place of the content of a counter that has been skipped."""


class SequenceRule(NamedTuple):
    """What a receiver believes of counters.

    ``lead_ns``     how much earlier than the time since the newest accepted frame explains one may
                    come: the spread of the network's latency, 0 or more [ns]
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

    def cautious_step_max(self, period_ns: int, elapsed_ns: int) -> int:
        """Return the largest step during caution, 0 once a newer counter may be an older one.

        The lead is at most half of QUARTER: the other counters are for the time that passes.
        """
        lead_ns = min(self.lead_ns, QUARTER // 2 * period_ns)
        step_max = 1 + (lead_ns + elapsed_ns) // period_ns
        return step_max if step_max < HALF - 1 else 0


def _measured_ns(span_ns: int, periods: int, longest_ns: int) -> int:
    """Return the period of a sender that sent for so many, within what is possible [ns]."""
    return min(max(span_ns // periods, PERIOD_NS_MIN), longest_ns)


class _Frame(NamedTuple):
    """A frame in sequence: how far ahead of the one in use, when it came, and what it is."""

    forward: int
    arrived_ns: int
    content: object


class _Caution:
    """The frames that wait, in order of arrival, which is that of their counters.

    ``period_ns`` of the sender, by the frames that are known [ns]
    ``wait_ns``   for how long [ns]
    ``until_ns``  end of the caution [ns]
    ``quiet_until_ns``  until when no frame is used; 0 before a second stream [ns]
    ``came``      the first content of each counter beyond that of the frame in use
    """

    def __init__(
        self, period_ns: int, wait_ns: int, until_ns: int, came: dict[int, object]
    ) -> None:
        self.period_ns, self.wait_ns, self.until_ns = period_ns, wait_ns, until_ns
        self._came = came
        self._waiting: list[_Frame] = []
        self.quiet_until_ns = 0

    def take(self, counter: int, frame: _Frame) -> SequenceResult | _Frame:
        """Let a frame wait; return the one that it confirms, which then is in use, or why none."""
        has_come = counter in self._came
        is_same = self._came.setdefault(counter, frame.content) == frame.content
        if has_come and is_same:
            return SequenceResult.REPEATED
        older = [one for one in self._waiting if one.forward < frame.forward]
        if has_come or len(older) < len(self._waiting):
            self._waiting = older
            return _CONTRADICTED
        ripe = [one for one in older if one.arrived_ns <= frame.arrived_ns - self.wait_ns]
        if frame.arrived_ns < self.quiet_until_ns:
            ripe = []
        self._waiting = [*older[len(ripe) :], frame]
        if not ripe:
            return SequenceResult.WAITING
        passed = ripe[-1].forward
        self._waiting = [one._replace(forward=one.forward - passed) for one in self._waiting]
        for behind in range(passed):
            self._came.pop((counter - frame.forward + 1 + behind) % COUNTERS, None)
        return ripe[-1]


class SequenceCheck:
    """Checks the counters of one message as they arrive.

    ``period_ns``  of the sender; a shorter one is measured, each time its counters wrap [ns]

    ``counter``           of the frame in use, 0 before the first
    ``arrival_ns``        when that came into use, None before the first [ns]
    ``lost``              counters skipped by frames in use. A late frame is refused and stays
                          counted; frames skipped by a resynchronisation are unknown and not counted
    ``resynchronised``    how often a run of refused frames was accepted as a restart of the sender
    ``second_sender_ns``  when a frame of a second sender was last noticed, None for never [ns]
    """

    def __init__(self, rule: SequenceRule, period_ns: int) -> None:
        for name, value, least in zip(SequenceRule._fields, rule, (0, 1, 0), strict=True):
            if value < least:
                raise ValueError(f"{name} = {value}: allowed is {least} or more")
        self._rule = rule
        self._period_ns_max = self._period_ns = max(period_ns, PERIOD_NS_MIN)
        self._late_ns_max = max(rule.lead_ns, rule.resync_ns)  # of a frame in the same stream
        self._next = _NONE
        self._contents: list[object] = []
        self._arrivals_ns = [0] * COUNTERS
        self._wrapped_ns = self._wrapped_at = self._wrapped_lost = 0
        self._last_refused = self._last_late = _NONE
        self._run = self._run_since_ns = self._late_run = 0
        self._foreign_ns: deque[int] = deque(maxlen=rule.resync_run)
        self._waited_ns = 0
        self._last_content: object = None
        self._caution: _Caution | None = None
        self._is_alone = True
        self.counter = 0
        self.arrival_ns: int | None = None
        self.lost = 0
        self.resynchronised = 0
        self.second_sender_ns: int | None = None

    @property
    def content(self) -> object:
        """The content in use."""
        return self._contents[self.counter]

    def check(self, counter: int, now_ns: int = 0, content: object = None) -> SequenceResult:
        """Check the frame that carries ``counter`` (0 to 255) and arrives at ``now_ns``.

        ``content``  what identifies the frame, its payload for instance; None for a receiver that
                     does not act on the message, and asks for no contradictions
        """
        if counter == self._next:  # nearly all frames; not after 255, so that a wrap is noticed
            self.counter, self.arrival_ns, self._run = counter, now_ns, 0
            self._next = counter + 1
            self._contents[counter] = content
            self._arrivals_ns[counter] = now_ns
            return _ACCEPTED
        if self.arrival_ns is None:
            return self._start(counter, now_ns, content)
        if self._caution is not None and now_ns >= self._caution.until_ns:
            self._caution = None
        frame = _Frame((counter - self.counter) % COUNTERS, now_ns, content)
        elapsed_ns = now_ns - self._arrivals_ns[self.counter]
        if self._caution is None:
            step_max = self._rule.step_max(self._period_ns, elapsed_ns)
            if step_max < frame.forward < HALF:
                step_max = self._rule.step_max(self._period_ns, elapsed_ns + self._held_up_ns())
        else:
            step_max = self._rule.cautious_step_max(self._caution.period_ns, elapsed_ns)
        if not 1 <= frame.forward <= step_max:
            return self._refuse(counter, frame)
        if self._caution is not None:
            return self._wait(counter, self._caution, frame)
        self._run = 0
        self._use(frame, now_ns)
        self._next = counter + 1
        return _ACCEPTED

    def _start(self, counter: int, now_ns: int, content: object) -> SequenceResult:
        """Take the first frame of a stream of counters."""
        self._contents = [None] * COUNTERS
        self._wrapped_ns, self._wrapped_at, self._run = now_ns, counter, 0
        self._wrapped_lost = self.lost
        if self._caution is None:
            self._foreign_ns.clear()
        else:  # the frame is to wait, and none is in use
            self.counter = (counter - 1) % COUNTERS
            self._arrivals_ns[self.counter] = now_ns
            old = self._caution
            self._caution = _Caution(old.period_ns, old.wait_ns, old.until_ns, {})
            return self._wait(counter, self._caution, _Frame(1, now_ns, content))
        self._contents[counter], self._arrivals_ns[counter] = content, now_ns
        self.counter, self.arrival_ns = counter, now_ns
        self._next = counter + 1
        return _ACCEPTED

    def _wait(self, counter: int, caution: _Caution, frame: _Frame) -> SequenceResult:
        """Let a frame in sequence wait, unless it contradicts another."""
        taken = caution.take(counter, frame)
        if taken is _CONTRADICTED:
            return self._restarted(counter, frame) or self._doubt(counter, frame.arrived_ns)
        if taken is not SequenceResult.REPEATED:
            self._run, self._is_alone = 0, False
            self._waited_ns = frame.arrived_ns
        if isinstance(taken, _Frame):
            self._use(taken, frame.arrived_ns)
            return SequenceResult.CONFIRMED
        return taken

    def _use(self, frame: _Frame, now_ns: int) -> None:
        """Use a frame in sequence, from ``now_ns`` on."""
        before, arrived_ns = self.counter, frame.arrived_ns
        counter = (before + frame.forward) % COUNTERS
        for skipped in range(before + 1, before + frame.forward):
            self._contents[skipped % COUNTERS] = _SKIPPED
        self.lost += frame.forward - 1
        if counter < before:
            passed = COUNTERS - self._wrapped_at + counter
            is_most = passed >= HALF and self.lost - self._wrapped_lost <= passed // 2
            # A few leaps measure nothing, and one that goes back may pass the wrap twice.
            if self._caution is None and is_most:
                span_ns = arrived_ns - self._wrapped_ns
                self._period_ns = _measured_ns(span_ns, passed, self._period_ns_max)
            self._wrapped_ns, self._wrapped_at = arrived_ns, counter
            self._wrapped_lost = self.lost
        self._contents[counter], self._arrivals_ns[counter] = frame.content, arrived_ns
        self.counter, self.arrival_ns = counter, now_ns

    def _refuse(self, counter: int, frame: _Frame) -> SequenceResult:
        """Refuse a frame, unless it shows that the sender has restarted."""
        restarted = self._restarted(counter, frame)
        if restarted is not None:
            return restarted
        now_ns = frame.arrived_ns
        is_ahead = 0 < frame.forward < HALF
        known = self._contents[counter]
        late_ns = -frame.forward % COUNTERS * self._period_ns
        is_explained = (known is None or known is _SKIPPED) and late_ns <= self._late_ns_max
        is_other = is_ahead or not (is_explained or known == frame.content)
        if is_other and (self._is_second(now_ns) or self._had_second()):
            return self._doubt_all(counter, now_ns)
        if is_ahead:
            return SequenceResult.TOO_FAR
        if known is _SKIPPED:
            is_next = counter == (self._last_late + 1) % COUNTERS
            self._late_run = self._late_run + 1 if is_next else 1
            self._last_late = counter
            self._contents[counter], self._arrivals_ns[counter] = frame.content, now_ns
            is_gap_left = self._contents[(counter + 1) % COUNTERS] is _SKIPPED
            is_contradiction = self._late_run >= self._rule.resync_run and is_gap_left
        else:
            is_contradiction = known is not None and known != frame.content
        if is_contradiction and frame.content is not None and not self._may_have_wrapped(frame):
            return self._doubt(counter, now_ns)
        return SequenceResult.OUT_OF_ORDER if frame.forward else SequenceResult.REPEATED

    def _may_have_wrapped(self, frame: _Frame) -> bool:
        """Whether time explains that the counters have come round to an old one again."""
        elapsed_ns = frame.arrived_ns - self._arrivals_ns[self.counter] + self._held_up_ns()
        explained_ns = elapsed_ns + self._rule.lead_ns
        return explained_ns >= (frame.forward or COUNTERS) * self._period_ns

    def _held_up_ns(self) -> int:
        """Return how much later the frame in use came than the earliest of the last counters.

        Half of the gaps between them show how slow a sender is; if that is slower than
        ``period_ns``, its frames are not late for that.
        """
        newest_ns = self._arrivals_ns[self.counter]
        came = [
            ((self.counter - one) % COUNTERS, newest_ns - self._arrivals_ns[one])
            for one in self._newest_until(newest_ns)
        ]
        gaps_ns = [(ago - since) // (b - a) for (a, since), (b, ago) in pairwise(came)]
        period_ns = max(self._period_ns, median_low(gaps_ns or [0]))
        return max((ago_ns - behind * period_ns for behind, ago_ns in came), default=0)

    def _restarted(self, counter: int, frame: _Frame) -> SequenceResult | None:
        """Count a refused frame; start anew if it shows that the sender has restarted."""
        now_ns, caution = frame.arrived_ns, self._caution
        if not self._run or counter != (self._last_refused + 1) % COUNTERS:
            if caution is not None and self._run and frame.content != self._last_content:
                self._note_second(caution, now_ns)
            self._run, self._run_since_ns = 0, now_ns
        self._run += 1
        self._last_refused, self._last_content = counter, frame.content
        # During caution a true frame must have had the time to interrupt the run.
        wait_ns = 0 if caution is None else caution.wait_ns
        is_run = self._run > self._rule.resync_run and now_ns - self._run_since_ns >= wait_ns
        if not is_run or now_ns - (self.arrival_ns or 0) < self._rule.resync_ns:
            return None
        self.resynchronised += 1
        if caution is not None:  # too few frames were known to measure it, so the run does
            span_ns = now_ns - self._run_since_ns
            caution.period_ns = _measured_ns(span_ns, self._run - 1, caution.period_ns)
        return self._start(counter, now_ns, frame.content)

    def _doubt(self, counter: int, now_ns: int) -> SequenceResult:
        """Be cautious after a frame that contradicts an accepted one, and go back to before it."""
        caution, until_ns = self._caution, now_ns + CAUTION_NS
        if caution is not None:
            caution.until_ns = until_ns
            if now_ns < caution.quiet_until_ns:
                caution.quiet_until_ns = now_ns + QUIET_NS
            if not self._is_alone:
                self._note_second(caution, now_ns)
            self._is_alone = True
            return _CONTRADICTED
        self._next, self._is_alone = _NONE, True
        # A frame that has overtaken this one, or has its counter, may be the forged one.
        overtaken_ns = self._arrivals_ns[counter]
        known = [
            one
            for one in self._newest_until(now_ns)
            if (one - counter) % COUNTERS >= HALF or self._arrivals_ns[one] > overtaken_ns
        ]
        period_ns = self._shortest_period_ns(known)
        longest_ns = self._rule.resync_ns // 2 or GAP_NS_MAX
        # A frame that came no later cannot be forged: its true one would have come by now.
        old_ns = now_ns - min(self._rule.lead_ns + longest_ns, QUARTER * period_ns)
        before = [one for one in known if self._arrivals_ns[one] <= old_ns]
        gap_ns = max(self._period_ns, min(self._longest_gap_ns(before[:GAPS]), longest_ns))
        # Shortly after the start there is none: the first one is then the least likely to be.
        before = before or known[-1:]
        last = before[0] if before else self.counter
        newer = ((last + 1 + step) % COUNTERS for step in range((self.counter - last) % COUNTERS))
        came = {one: self._contents[one] for one in newer if self._contents[one] is not _SKIPPED}
        self._caution = _Caution(period_ns, round(WAIT_CYCLES * gap_ns), until_ns, came)
        if not before:
            return _CONTRADICTED
        self.counter, self.arrival_ns = last, now_ns
        return SequenceResult.TAKEN_BACK

    def _shortest_period_ns(self, known: list[int]) -> int:
        """Return the sender's period by the frames that are known, newest first, if shorter.

        Where the network drops most frames, no wrap of the counters measures it.
        """
        if not known or (passed := (known[0] - known[-1]) % COUNTERS) < GAPS:
            return self._period_ns
        span_ns = self._arrivals_ns[known[0]] - self._arrivals_ns[known[-1]]
        return _measured_ns(span_ns, passed, self._period_ns)

    def _had_second(self) -> bool:
        """Whether another stream beside this one has caused the caution."""
        return self._caution is not None and self._caution.quiet_until_ns > 0

    def _doubt_all(self, counter: int, now_ns: int) -> SequenceResult:
        """Use no frame that waits, since those of another stream come beside them."""
        result = self._doubt(counter, now_ns)
        if self._caution is not None:
            self._caution.quiet_until_ns = now_ns + QUIET_NS
            self._note_second(self._caution, now_ns)
        return result

    def _note_second(self, caution: _Caution, now_ns: int) -> None:
        """Note a frame of a second sender; caution lasts from it on."""
        caution.until_ns, self.second_sender_ns = now_ns + CAUTION_NS, now_ns

    def _newest_until(self, time_ns: int) -> list[int]:
        """Return the counters that came up to ``time_ns`` and are known, newest first."""
        return [
            one
            for one in ((self.counter - behind) % COUNTERS for behind in range(HALF))
            if self._arrivals_ns[one] <= time_ns
            and self._contents[one] is not None
            and self._contents[one] is not _SKIPPED
        ]

    def _longest_gap_ns(self, counters: list[int]) -> int:
        """Return the longest time between the arrivals of frames, newest first."""
        arrivals_ns = [self._arrivals_ns[one] for one in counters]
        return max((a - b for a, b in pairwise(arrivals_ns)), default=0)

    def _is_second(self, now_ns: int) -> bool:
        """Whether a frame of another stream is one of many, beside frames in sequence.

        Without these it is of the only sender, which has started anew.
        """
        self._foreign_ns.append(now_ns)
        since_ns = self._foreign_ns[0]
        in_sequence_ns = max(self._arrivals_ns[self.counter], self._waited_ns)
        is_many = len(self._foreign_ns) == self._foreign_ns.maxlen
        return is_many and now_ns - since_ns <= FOREIGN_NS and in_sequence_ns > since_ns
