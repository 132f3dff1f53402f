"""Counters and contents of one message as they arrive: ``counter_rule`` and ``second_sender``."""

from .counter_rule import CounterResult, CounterRule, counter_step, start_counters
from .protection import COUNTERS, HALF
from .sender_watch import SenderWatch

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
        self._watch = SenderWatch(COUNTERS)
        self._contents = self._watch.contents
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
            self._contents[counter] = content
            self._contents[counter - HALF] = None
            return _ACCEPTED
        if self.arrival_ns is not None and self.counter != self._state.counter:
            self._catch_up(self.arrival_ns)
        self._state, result = counter_step(self._rule, self._state, counter, now_ns)
        if result is _ACCEPTED:
            self.counter, self.arrival_ns, self._next = counter, now_ns, counter + 1
        if content is not None and self._watch.on_frame(counter, now_ns, content):
            if self._watch.shows:
                self.second_sender_ns = now_ns
            if not self._watch.newest == self.counter == counter:
                self._next = _NEVER_NEXT
        return result

    def _catch_up(self, arrival_ns: int) -> None:
        """Give the states the newest of the frames that each had the next counter."""
        counter, passed = self.counter, self.counter - self._state.counter
        self._state = self._state._replace(counter=counter, arrival_ns=arrival_ns, run=0)
        self._watch.catch_up(counter, passed, arrival_ns)
