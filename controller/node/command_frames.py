"""The frames that steer, STEERING_COMMAND or a STEERING_PLAN in its place, and when each was sent.

The plant echoes the counter of the command it applies in every STEERING_STATUS. The round trip is
the time from sending a counter to its first echo: the downlink latency, the wait for the plant's
next status, and the uplink latency. Later echoes of the same counter add no information. A command
that was lost or overtaken by a newer one is never applied and has no echo.
"""

from collections.abc import MutableSequence

from ...dbc.messages import COMMAND_COUNTERS, Mode, Sender, SteeringCommand, SteeringPlan
from ...runtime.fast_named_tuple import field_values
from ...runtime.frame import Frame
from ..history.plan import limit_plan, plan_message
from ..limits.steer_limits import SteerLimits

_command = field_values(SteeringCommand)
IN_FLIGHT_MAX = 4096
"""Commands whose sending time is stored: 4 s at 1 kHz, and far fewer than the counter's values, so
that a counter that has wrapped is not mistaken for the old one."""


def echoed_age(count: int, counter: int) -> int | None:
    """Return how many commands ago the one with an echoed counter was sent, 0 for the newest.

    ``count``  commands sent so far. None if no command of IN_FLIGHT_MAX has the counter
    """
    age = (count - 1 - counter) % COMMAND_COUNTERS
    if age >= count or age >= IN_FLIGHT_MAX:
        return None
    return age


class CommandFrames:
    """Makes the frames, and stores when each was sent, and its angle.

    ``periods_per_sample``  sensor period over control period

    ``count``  how many were sent, and ``plans``, how many of them were plans
    """

    def __init__(self, limits: SteerLimits, periods_per_sample: float) -> None:
        self._limits, self._periods_per_sample = limits, periods_per_sample
        self._commands, self._plans = Sender(SteeringCommand), Sender(SteeringPlan)
        self._sent_ns = [0] * IN_FLIGHT_MAX
        self._steer_rad = [0.0] * IN_FLIGHT_MAX
        self._is_echoed = [False] * IN_FLIGHT_MAX
        self.count = self.plans = 0

    def on_sent(self, now_ns: int, steer_rad: float = 0.0) -> int:
        """Store when a command is sent, and its angle unless it is a plan; returns its counter."""
        count = self.count
        index = count % IN_FLIGHT_MAX
        self._sent_ns[index] = now_ns
        self._steer_rad[index] = steer_rad
        self._is_echoed[index] = False
        self.count = count + 1
        return count % COMMAND_COUNTERS

    def on_echo(self, counter: int) -> tuple[int, float, bool] | None:
        """Return when the command in effect was sent [ns], its angle, and whether this is its first
        echo.

        None if the command with this counter is not stored.
        """
        age = echoed_age(self.count, counter)
        if age is None:
            return None
        index = (self.count - 1 - age) % IN_FLIGHT_MAX
        is_first = not self._is_echoed[index]
        self._is_echoed[index] = True
        return self._sent_ns[index], self._steer_rad[index], is_first

    def command(self, steer_rad: float, mode: Mode, now_ns: int) -> Frame:
        """Return the frame of a command."""
        number = self.on_sent(now_ns, steer_rad)
        return self._commands.frame(
            _command(steer_rad=steer_rad, command_counter=number, mode=mode)
        )

    def plan(
        self,
        row: MutableSequence[float],
        acting: int,
        before: MutableSequence[float],
        mode: Mode,
        now_ns: int,
    ) -> Frame:
        """Return the frame of a plan after limiting its ``row``.

        ``acting``  index of the value that acts first
        ``before``  the row of the period before
        """
        limit_plan(self._limits, self._periods_per_sample, acting, before, row)
        self.plans += 1
        commands, plans = self._commands, self._plans
        plans.counter = commands.counter  # one sequence, since each takes the other's place
        frame = plans.frame(plan_message(row, self.on_sent(now_ns), mode))
        commands.counter = plans.counter
        return frame
