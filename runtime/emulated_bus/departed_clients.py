"""Frames that clients of a channel have left behind.

Frames that a client has submitted are still sent after it has gone, like the last frames of a
program that ends. At most LEFT_FRAMES_MAX frames of departed clients wait on one channel, so that
no client fills the bus by joining and leaving. Beyond that, the client that left the most loses
its frames.
"""

from collections.abc import Callable, Sized

LEFT_FRAMES_MAX = 1024
"""Frames of departed clients that may wait on one channel."""


class DepartedClients:
    """Counts the frames that wait, by client.

    ``withdraw``  takes a client's waiting frames from the bus, and returns them
    ``forget``    is called with each client that has no frames left

    ``waiting``    frames of each client
    ``discarded``  frames that were never sent
    """

    def __init__(self, withdraw: Callable[[int], Sized], forget: Callable[[int], None]) -> None:
        self._withdraw, self._forget = withdraw, forget
        self.waiting: dict[int, int] = {}
        self.discarded = 0

    def add(self, number: int, frames: int) -> None:
        """Take a client that leaves so many frames."""
        if not frames:
            self.forget(number)
            return
        self.waiting[number] = frames
        for most in sorted(self.waiting, key=self.waiting.__getitem__, reverse=True):
            if sum(self.waiting.values()) <= LEFT_FRAMES_MAX:
                break
            withdrawn = len(self._withdraw(most))
            self.discarded += withdrawn
            self._less(most, withdrawn)

    def on_sent(self, number: int) -> None:
        """Count a frame of a client that is complete."""
        self._less(number, 1)

    def _less(self, number: int, frames: int) -> None:
        self.waiting[number] -= frames
        if not self.waiting[number]:
            self.forget(number)

    def forget(self, number: int) -> None:
        """Forget a client whose frames the bus has dropped."""
        self.waiting.pop(number, None)
        self._forget(number)
