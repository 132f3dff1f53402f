"""Watch for a second sender of one message: the step of ``second_sender``, and its contents."""

from collections.abc import Sequence

from .second_sender import SenderState, sender_step, start_senders

ECHO_TICKS = 256
"""An echo comes before a node has sent in more ticks than this."""


def second_sender_line(messages: Sequence[str]) -> str:
    """Return in words which messages have had a second sender; empty without any."""
    why = "two programs on the bus send what only one may"
    return f"second sender of {', '.join(messages)}: {why}" if messages else ""


class SenderWatch:
    """Remembers the contents of the last half turn of counters.

    ``counters``  number of values of the counter

    ``contents``  by counter; None for one that has not come in the last half turn
    ``shows``     whether the last frame shows a second sender
    """

    def __init__(self, counters: int) -> None:
        self._counters, self._half = counters, counters // 2
        self._state: SenderState | None = None
        self.contents: list[object] = [None] * counters
        self.shows = False

    @property
    def newest(self) -> int | None:
        """The counter that is furthest ahead; None before the first."""
        return None if self._state is None else self._state.newest

    def on_frame(self, counter: int, now_ns: int, content: object) -> bool:
        """Judge a frame that arrives at ``now_ns``; returns False for one that comes again."""
        contents, self.shows = self.contents, False
        if self._state is None:
            self._state = start_senders(counter, now_ns)
            contents[counter] = content
            return True
        forward = (counter - self._state.newest) % self._counters
        known = None
        if 0 < forward <= self._half:
            for step in range(forward):
                contents[counter - step] = contents[counter - step - self._half] = None
        else:
            known = contents[counter]
            if known == content:
                return False
        contents[counter] = content
        self._state, self.shows = sender_step(
            self._counters, self._state, counter, known is not None, now_ns
        )
        return True

    def catch_up(self, counter: int, passed: int, arrival_ns: int) -> None:
        """Take the last of ``passed`` frames that each had the next counter, without a wrap."""
        x = self._state
        if x is not None:
            self._state = x._replace(
                newest=counter, counter=counter, last_ns=arrival_ns, run=x.run + passed,
                is_behind=False, changes=x.changes + x.is_behind,
                change_ns=x.change_ns if x.changes or not x.is_behind else arrival_ns,
            )  # fmt: skip
