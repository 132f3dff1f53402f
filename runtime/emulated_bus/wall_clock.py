"""Times of the monotonic clock as times of the wall clock, with their distances kept."""

import time

_FOLLOWED_NS = 1_000_000
"""The wall clock is followed when it is this far off: it was set, or the machine has slept."""
_SURE_NS = 100_000
"""A reading that took longer was interrupted, and is useless."""


class WallClock:
    """Converts times; one second on the bus stays one second in a log.

    Reading both clocks again for every frame would put their reading errors into the distances
    between frames, up to a whole stall of the machine.
    """

    def __init__(self) -> None:
        self._offset_ns, _ = _read_offset_ns()

    def update(self) -> None:
        """Follow the wall clock when it has moved away."""
        offset_ns, took_ns = _read_offset_ns()
        if took_ns < _SURE_NS and abs(offset_ns - self._offset_ns) > _FOLLOWED_NS:
            self._offset_ns = offset_ns

    def at(self, monotonic_ns: int) -> int:
        """Return the time since the epoch [ns]."""
        return monotonic_ns + self._offset_ns


def _read_offset_ns() -> tuple[int, int]:
    """Return wall clock minus monotonic clock, and how long the reading took [ns]."""
    before_ns = time.monotonic_ns()
    wall_ns = time.time_ns()
    after_ns = time.monotonic_ns()
    return wall_ns - (before_ns + after_ns) // 2, after_ns - before_ns
