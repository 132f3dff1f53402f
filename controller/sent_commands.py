"""When each command was sent, by its counter: what its echoes are held against.

The plant echoes the counter of the command it applies, in every STEERING_STATUS. From sending a
counter to its first echo pass the latency down, the wait for the plant's next status, and the
latency up: the round trip. Later echoes of the same counter say nothing new of that; so does a
command that was never applied, because the network lost it or a newer one overtook it.
"""

from typing import NamedTuple

from ..dbc.messages import COMMAND_COUNTERS
from ..runtime.record import new_record

IN_FLIGHT_MAX = 4096
"""Commands whose sending time is remembered: 4 s at 1 kHz, and far below the values of the counter,
so that a counter that comes round again is not taken for the old one."""


class Echo(NamedTuple):
    """When the command of an echo was sent [ns], and whether the echo is its first."""

    sent_ns: int
    is_first: bool


class SentCommands:
    """Keeps the sending times; ``count`` is how many commands were sent."""

    def __init__(self) -> None:
        self._sent_ns = [0] * IN_FLIGHT_MAX
        self._is_echoed = [False] * IN_FLIGHT_MAX
        self.count = 0

    @property
    def next_counter(self) -> int:
        """The counter of the command that is sent next."""
        return self.count % COMMAND_COUNTERS

    def on_sent(self, now_ns: int) -> None:
        """Remember when a command was sent."""
        index = self.count % IN_FLIGHT_MAX
        self._sent_ns[index] = now_ns
        self._is_echoed[index] = False
        self.count += 1

    def on_echo(self, counter: int) -> Echo | None:
        """Take the counter of a command in effect; None where it is not remembered."""
        age = (self.count - 1 - counter) % COMMAND_COUNTERS
        if age >= min(self.count, IN_FLIGHT_MAX):
            return None
        index = (self.count - 1 - age) % IN_FLIGHT_MAX
        is_first = not self._is_echoed[index]
        self._is_echoed[index] = True
        return new_record(Echo, (self._sent_ns[index], is_first))
