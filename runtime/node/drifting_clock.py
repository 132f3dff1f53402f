"""A node whose oscillator is off: its timers run fast or slow against the bus.

    local = t + t ppm / 10⁶ + t² drift / (2 · 10⁶)        from the start [s], drift [ppm/s]

Two nodes of one period beat against each other: at +100 and -100 ppm their phase moves by a period
in 5000 periods.
"""

from collections.abc import Sequence

from ..frame import Frame
from .node import NS_PER_S, Node

_PPM = 1e-6


class DriftingClock:
    """Runs ``node`` by a clock of its own.

    ``ppm``          how much too fast it runs at the start
    ``drift_ppm_s``  how fast that changes [ppm/s]
    ``start_ns``     when it shows the right time [ns]
    """

    def __init__(self, node: Node, ppm: float, drift_ppm_s: float = 0.0, start_ns: int = 0) -> None:
        self._node = node
        self._start_ns = start_ns
        self._rate = 1.0 + ppm * _PPM
        self._half_drift = 0.5 * drift_ppm_s * _PPM / NS_PER_S

    @property
    def deadline_ns(self) -> int:
        """When the node's next tick is due, by the time of the bus [ns]."""
        local_ns = self._node.deadline_ns - self._start_ns
        since_ns = int(local_ns / self._rate)
        for _ in range(3):  # Newton's method; the clocks are all but equal
            slope = self._rate + 2.0 * self._half_drift * since_ns
            since_ns += int((local_ns - self._local_ns(since_ns)) / slope)
        while self._local_ns(since_ns) < local_ns:
            since_ns += 1
        return self._start_ns + since_ns

    @property
    def finished(self) -> bool:
        """Whether the node has finished."""
        return self._node.finished

    def local_ns(self, now_ns: int) -> int:
        """What the node's clock shows [ns]."""
        return self._start_ns + self._local_ns(now_ns - self._start_ns)

    def _local_ns(self, since_ns: int) -> int:
        return int(since_ns * (self._rate + self._half_drift * since_ns))

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Pass a frame to the node."""
        return self._node.on_frame(frame, self.local_ns(now_ns))

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Let the node tick."""
        return self._node.on_tick(self.local_ns(now_ns))
