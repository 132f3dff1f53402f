"""The frames that steer: STEERING_COMMAND, or a STEERING_PLAN in its place."""

from ...dbc.messages import Mode, SteeringCommand, SteeringPlan
from ...dbc.sending import Sender
from ...runtime.frame import Frame
from ..history.plan import limit_plan, plan_message
from ..interface.limits import SteerLimits
from .sent_frames import SentCommands


class CommandFrames:
    """Makes the frames, and stores in ``sent`` when each was sent.

    ``periods_per_sample``  sensor period over control period

    ``plans``  how many of the frames were plans
    """

    def __init__(self, limits: SteerLimits, periods_per_sample: float) -> None:
        self._limits, self._periods_per_sample = limits, periods_per_sample
        self._commands, self._plans = Sender(SteeringCommand), Sender(SteeringPlan)
        self.sent = SentCommands()
        self.plans = 0

    def command(self, steer_rad: float, mode: Mode, now_ns: int) -> Frame:
        """Return the frame of a command."""
        return self._commands.frame((steer_rad, self.sent.on_sent(now_ns), mode))

    def plan(
        self, row: list[float], acting: int, before_rad: float, mode: Mode, now_ns: int
    ) -> Frame:
        """Return the frame of a plan after limiting its ``row``.

        ``acting``      index of the value that acts first
        ``before_rad``  the command of the period before
        """
        limit_plan(self._limits, self._periods_per_sample, before_rad, acting, row)
        self.plans += 1
        return self._plans.frame(plan_message(row, self.sent.on_sent(now_ns), mode))
