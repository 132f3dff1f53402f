"""Challenges whose sender has not yet proved that it is present.

Anybody can send a recorded status message again: it is authentic, and its challenge is an old one.
Whether it is new shows only when the peer echoes this end's own challenge. Until then each
challenge is answered in turn, by the echo of one status message for each status message that
brought it. A recording thus costs one answer for each of its frames and never a second one, and the
true challenge, which comes with a new frame in each status period, waits for one answer to each of
the others.
"""

KEPT = 16
"""How many challenges are remembered: those with the highest counters. The true one has the
highest, unless a clock was set back."""


class Challenges:
    """Challenges to be answered, in the order in which they came."""

    def __init__(self) -> None:
        self._newest: dict[bytes, int] = {}
        self._unanswered: list[bytes] = []

    def add(self, challenge: bytes, counter: int) -> bool:
        """Store the challenge of a status message; returns whether that message is new."""
        if counter <= self._newest.get(challenge, -1):
            return False
        self._newest[challenge] = counter
        if challenge not in self._unanswered:
            self._unanswered.append(challenge)
        if len(self._newest) > KEPT:
            oldest = min(self._newest, key=self._newest.__getitem__)
            del self._newest[oldest]
            if oldest in self._unanswered:
                self._unanswered.remove(oldest)
        return True

    def answer(self) -> bytes | None:
        """Return the challenge that has waited longest, which is then answered; None for none."""
        return self._unanswered.pop(0) if self._unanswered else None
