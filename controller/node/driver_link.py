"""What the controller hears of the driver (HAND_WHEEL_STATE) and answers (HAND_WHEEL_FEEDBACK).

The feedback itself is computed at the wheel; the controller says who steers, and the ratio.
"""

from collections import Counter

from ...dbc.messages import HandWheelFeedback, HandWheelState, Sender, SteeredBy
from ...dbc.reception import Reception
from ...runtime.frame import Frame
from ..who_steers import HandWheelSettings, Steering, steering_rule, steering_step


class DriverLink:
    """Decides who steers, once each control period.

    ``steered_by``  since the last decision
    ``changes``     how often each has begun to steer
    """

    def __init__(self, settings: HandWheelSettings, reception: Reception, start_ns: int) -> None:
        self._rule, self._ratio = steering_rule(settings), settings.steering_ratio
        self._check = reception.newest(HandWheelState)
        self._steering = Steering(SteeredBy.LAW, start_ns)
        self._torque_n_m = 0.0
        self._sender = Sender(HandWheelFeedback)
        self.changes: Counter[str] = Counter()

    @property
    def steered_by(self) -> SteeredBy:
        """Who steers."""
        return self._steering.steered_by

    def report(self) -> dict[str, object]:
        """Return who steers at the end, and how often each has begun to."""
        return {"steered_by": self.steered_by.name.lower(), "changes": dict(self.changes)}

    def on_state(self, message: HandWheelState) -> None:
        """Store the driver's torque."""
        self._torque_n_m = message.driver_torque_n_m

    def decide(self, now_ns: int, *, can_steer: bool) -> SteeredBy:
        """Return who steers from now on; ``can_steer``: whether the law can."""
        before, arrival_ns = self._steering, self._check.arrival_ns
        age_ns = None if arrival_ns is None else now_ns - arrival_ns
        heard = self._torque_n_m, age_ns
        after = steering_step(self._rule, before, heard, now_ns, can_steer=can_steer)
        if after.steered_by is not before.steered_by:
            self.changes[after.steered_by.name.lower()] += 1
        self._steering = after
        return after.steered_by

    def frame(self) -> Frame:
        """Return the answer."""
        return self._sender.frame(
            HandWheelFeedback(
                feedback_torque_n_m=0.0,
                steering_ratio=self._ratio,
                answered_state=self._check.counter,
                steered_by=self.steered_by,
            )
        )
