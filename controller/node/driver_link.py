"""Link to the driver: what is heard (HAND_WHEEL_STATE) and answered (HAND_WHEEL_FEEDBACK).

The feedback itself is computed at the wheel; the controller says who steers, and the ratio, and
adds the torque by which the law assists.
"""

from collections import Counter

from ...dbc.messages import HandWheelFeedback, HandWheelState, Sender, SteeredBy
from ...dbc.reception import Reception
from ...runtime.frame import Frame
from ...runtime.node import NEVER_NS
from ..who_steers import HandWheelSettings, Steering, assist_n_m, steering_rule, steering_step


class DriverLink:
    """Decides who steers, once each control period.

    ``newest``      what was heard of the driver last
    ``steered_by``  since the last decision
    ``changes``     how often each has begun to steer
    """

    def __init__(
        self, settings: HandWheelSettings, reception: Reception, start_ns: int, period_s: float
    ) -> None:
        self._rule = steering_rule(settings, period_s)
        self._check = reception.newest(HandWheelState)
        self._steering = Steering(int(SteeredBy.LAW), start_ns, 0.0)
        self._assist_n_m = 0.0
        self.newest = HandWheelState(0.0, 0.0, 0.0)
        self._sender = Sender(HandWheelFeedback)
        self.changes: Counter[str] = Counter()

    @property
    def steered_by(self) -> SteeredBy:
        """Who steers."""
        return SteeredBy(self._steering.steered_by)

    def report(self) -> dict[str, object]:
        """Return who steers at the end, and how often each has begun to."""
        return {"steered_by": self.steered_by.name.lower(), "changes": dict(self.changes)}

    def decide(self, now_ns: int, law_rad: float, *, can_steer: bool) -> Steering:
        """Return who steers from now on; ``can_steer``: whether the law can, with its command."""
        before, arrival_ns = self.steered_by, self._check.arrival_ns
        age_ns = NEVER_NS if arrival_ns is None else now_ns - arrival_ns
        angle_rad, rate_rad_s, torque_n_m = self.newest
        rule, heard = self._rule, (torque_n_m, age_ns, now_ns)
        self._steering = steering_step(rule, self._steering, *heard, can_steer)
        self._assist_n_m = assist_n_m(rule, self._steering, law_rad, angle_rad, rate_rad_s)
        if self.steered_by is not before:
            self.changes[self.steered_by.name.lower()] += 1
        return self._steering

    def frame(self) -> Frame:
        """Return the answer."""
        return self._sender.frame(
            HandWheelFeedback(
                feedback_torque_n_m=self._assist_n_m,
                steering_ratio=self._rule.ratio,
                answered_state=self._check.counter,
                steered_by=self.steered_by,
            )
        )
