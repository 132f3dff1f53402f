"""The sending time of each command, by its counter, for comparison with its echoes.

The plant echoes the counter of the command it applies, in every STEERING_STATUS. The round trip is
the time from sending a counter to its first echo: the downlink latency, the wait for the plant's
next status, and the uplink latency. Later echoes of the same counter add no information. A command
that was lost or overtaken by a newer one is never applied and has no echo.
"""

from typing import NamedTuple

from ..dbc.messages import COMMAND_COUNTERS
from ..runtime.record import new_record

IN_FLIGHT_MAX = 4096
"""Commands whose sending time is stored: 4 s at 1 kHz, and far fewer than the counter's values, so
that a counter that has wrapped is not mistaken for the old one."""


class Echo(NamedTuple):
    """When the command of an echo was sent [ns], and whether the echo is its first."""

    sent_ns: int
    is_first: bool


class SentCommands:
    """Stores the sending times; ``count`` is the number of commands sent."""

    def __init__(self) -> None:
        self._sent_ns = [0] * IN_FLIGHT_MAX
        self._is_echoed = [False] * IN_FLIGHT_MAX
        self.count = 0

    @property
    def next_counter(self) -> int:
        """The counter of the next command."""
        return self.count % COMMAND_COUNTERS

    def on_sent(self, now_ns: int) -> None:
        """Store when a command was sent."""
        index = self.count % IN_FLIGHT_MAX
        self._sent_ns[index] = now_ns
        self._is_echoed[index] = False
        self.count += 1

    def on_echo(self, counter: int) -> Echo | None:
        """Return the echo for the counter of a command in effect; None if it is not stored."""
        age = (self.count - 1 - counter) % COMMAND_COUNTERS
        if age >= min(self.count, IN_FLIGHT_MAX):
            return None
        index = (self.count - 1 - age) % IN_FLIGHT_MAX
        is_first = not self._is_echoed[index]
        self._is_echoed[index] = True
        return new_record(Echo, (self._sent_ns[index], is_first))
