"""Round trip of the steering command, measured on the wire.

The plant echoes the counter of the command it applies, in every STEERING_STATUS. From sending a
counter to its first echo pass the latency down, the wait for the plant's next status, and the
latency up. Later echoes of the same counter say nothing new and are ignored; so is a command that
was never applied, because the network lost it or a newer one overtook it.
"""

from runtime.statistics import DurationStatistics

IN_FLIGHT_MAX = 4096
"""Commands whose sending time is remembered: 4 s at 1 kHz, and far below the 65536 values of the
counter, so that a counter that comes round again is not taken for the old one."""


class RoundTrip:
    """Pairs the commands sent with their echoes."""

    def __init__(self) -> None:
        self._sent_ns: dict[int, int] = {}
        self._statistics = DurationStatistics()

    @property
    def statistics(self) -> DurationStatistics:
        """The round trips measured so far."""
        return self._statistics

    def on_sent(self, command_counter: int, now_ns: int) -> None:
        """Remember when a command was sent."""
        if len(self._sent_ns) >= IN_FLIGHT_MAX:
            del self._sent_ns[next(iter(self._sent_ns))]  # the oldest: a dict keeps its order
        self._sent_ns[command_counter] = now_ns

    def on_echo(self, command_counter: int, now_ns: int) -> None:
        """Take the counter of the command that is applied now."""
        sent_ns = self._sent_ns.pop(command_counter, None)
        if sent_ns is not None:
            self._statistics.record(now_ns - sent_ns)
