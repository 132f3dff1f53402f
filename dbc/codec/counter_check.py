"""Counters and contents of one message as they arrive: ``counter_rule`` and ``second_sender``."""

from .counter_rule import CounterResult, CounterRule, counter_step, start_counters
from .protection import COUNTERS, HALF
from .second_sender import SenderState, sender_step, start_senders

_SLOTS = HALF - 1
"""Mask of a counter for the place of its content: half a turn of them is kept."""
_NEVER_NEXT = -1
_ACCEPTED = CounterResult.ACCEPTED


class CounterCheck:
    """Checks the frames of one message.

    ``counter``     of the newest accepted frame, 0 before the first
    ``arrival_ns``  when that came, None before the first [ns]
    ``second_sender_ns``  when a frame last showed a second sender, None for never [ns]
    """

    def __init__(self, rule: CounterRule) -> None:
        for name, value, least in zip(CounterRule._fields, rule, (0, 1, 0, 1), strict=True):
            if value < least:
                raise ValueError(f"{name} = {value}: allowed is {least} or more")
        self._rule = rule
        self._state = start_counters(rule)
        self._senders: SenderState | None = None
        self._contents: list[object] = [None] * HALF
        self._next = _NEVER_NEXT
        self.counter = 0
        self.arrival_ns: int | None = None
        self.second_sender_ns: int | None = None

    @property
    def lost(self) -> int:
        """Counters skipped by accepted frames (``CounterState.lost``)."""
        return self._state.lost

    @property
    def resynchronised(self) -> int:
        """How often a restart of the sender was accepted."""
        return self._state.restarts

    def check(self, counter: int, now_ns: int = 0, content: object = None) -> CounterResult:
        """Check the frame that carries ``counter`` (0 to 255) and arrives at ``now_ns``.

        ``content``  what identifies the frame, its payload for instance; None for a receiver that
                     does not ask for a second sender
        """
        if counter == self._next:  # nearly all frames; not after 255, so that a wrap is noticed
            self.counter, self.arrival_ns = counter, now_ns
            self._next = counter + 1
            self._contents[counter & _SLOTS] = content
            return _ACCEPTED
        if self.arrival_ns is not None and self.counter != self._state.counter:
            self._catch_up(self.arrival_ns)
        self._state, result = counter_step(self._rule, self._state, counter, now_ns)
        if result is _ACCEPTED:
            self.counter, self.arrival_ns, self._next = counter, now_ns, counter + 1
        if content is not None:
            self._watch(counter, now_ns, content)
        return result

    def _catch_up(self, arrival_ns: int) -> None:
        """Give the states the newest of the frames that each had the next counter."""
        counter, passed = self.counter, self.counter - self._state.counter
        self._state = self._state._replace(counter=counter, arrival_ns=arrival_ns, run=0)
        x = self._senders
        if x is not None:
            self._senders = x._replace(
                newest=counter, counter=counter, last_ns=arrival_ns, run=x.run + passed,
                is_behind=False, changes=x.changes + x.is_behind,
                change_ns=x.change_ns if x.changes or not x.is_behind else arrival_ns,
            )  # fmt: skip

    def _watch(self, counter: int, now_ns: int, content: object) -> None:
        """Note a second sender; a frame that comes again shows nothing."""
        if self._senders is None:
            self._senders = start_senders(counter, now_ns)
            self._contents[counter & _SLOTS] = content
            return
        forward = (counter - self._senders.newest) % COUNTERS
        known = None
        if 0 < forward <= HALF:
            for skipped in range(1, forward):
                self._contents[(counter - skipped) & _SLOTS] = None
        else:
            known = self._contents[counter & _SLOTS]
            if known == content:
                return
        self._contents[counter & _SLOTS] = content
        self._senders, shows = sender_step(self._senders, counter, known is not None, now_ns)
        if shows:
            self.second_sender_ns = now_ns
        if not self._senders.newest == self.counter == counter:
            self._next = _NEVER_NEXT
