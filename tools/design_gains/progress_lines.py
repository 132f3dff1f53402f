"""Progress where no terminal shows bars: a line every few seconds, as in a job's log."""

import sys
import time
from collections.abc import Callable, Mapping

EVERY_S = 10.0


class ProgressLines:
    """Prints on standard error how much of each search is done.

    ``is_shown``  whether to print; a terminal has bars instead
    """

    def __init__(
        self, name: str, *, is_shown: bool, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._name = name
        self._is_shown = is_shown
        self._clock_s = clock_s
        self._begin_s = self._last_s = clock_s()

    def update(self, done: Mapping[str, float]) -> None:
        """Print what is done of each, 0 to 1, unless a line was printed shortly before."""
        now_s = self._clock_s()
        if not self._is_shown or now_s - self._last_s < EVERY_S:
            return
        self._last_s = now_s
        shares = ", ".join(f"{what} {100.0 * share:.0f} %" for what, share in done.items())
        text = f"{self._name}: {now_s - self._begin_s:.0f} s: {shares} of the search"
        print(text, file=sys.stderr, flush=True)
