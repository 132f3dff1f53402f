"""How far a search is, line by line, where there is no terminal for bars."""

import math
import sys
import time
from collections.abc import Callable, Mapping

EVERY_S = 10.0


class ProgressLines:
    """Prints on standard error how much of each search is done, and how long the rest may take.

    ``is_shown``  whether to print; a terminal has bars instead
    ``minutes``   after which a search ends
    """

    def __init__(
        self,
        name: str,
        *,
        is_shown: bool,
        minutes: float = math.inf,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._name = name
        self._is_shown = is_shown
        self._longest_s = 60.0 * minutes
        self._clock_s = clock_s
        self._begin_s = self._last_s = clock_s()
        self._first: dict[str, tuple[float, float]] = {}

    def update(self, done: Mapping[str, float]) -> None:
        """Print what is done of each, 0 to 1, unless a line was printed shortly before.

        At 1 the search has ended, and its best is confirmed.
        """
        now_s = self._clock_s()
        for what, share in done.items():
            if share > 0.0 and share >= self._first.get(what, (0.0, math.inf))[1]:
                continue
            self._first[what] = now_s, share
        if not (self._is_shown and done) or now_s - self._last_s < EVERY_S:
            return
        self._last_s = now_s
        shares = ", ".join(self._in_words(what, share, now_s) for what, share in done.items())
        text = f"{self._name}: {now_s - self._begin_s:.0f} s: {shares} of the search"
        print(text, file=sys.stderr, flush=True)

    def _in_words(self, what: str, share: float, now_s: float) -> str:
        if share >= 1.0:
            return f"{what} 100 % (confirming its best)"
        begin_s, first = self._first[what]
        if share <= first:
            return f"{what} {100.0 * share:.0f} %"
        since_s = now_s - begin_s
        left_s = min(since_s * (1.0 - share) / (share - first), self._longest_s - since_s)
        what_is_left = f"about {left_s:.0f} s left" if left_s >= 1.0 else "less than 1 s left"
        return f"{what} {100.0 * share:.0f} % ({what_is_left})"
