"""Hand wheel: who steers, the law or the driver, and which angle the driver asks for.

The controller decides (HAND_WHEEL_FEEDBACK). Until it has, and for good if it falls silent then,
the driver steers. Both messages come through the latency of commands, and the angle acts through
the same guard as a command.
"""

from pydantic import Field

from ...dbc.messages import HandWheelFeedback, HandWheelState, SteeredBy
from ...runtime.settings import Settings


class HandWheelSettings(Settings):
    """`[hand_wheel]`: a hand wheel on the bus may steer."""

    steering_ratio: float = Field(16.0, ge=1.0, le=40.0)
    """Angle of the hand wheel over that of the road wheels, until HAND_WHEEL_FEEDBACK says it."""


class HandWheelLink:
    """Keeps what the controller said last.

    ``driver_steers``  whether HAND_WHEEL_STATE sets the target of the wheels, and no command
    """

    def __init__(self, settings: HandWheelSettings | None) -> None:
        self.driver_steers = settings is not None
        self._ratio = 1.0 if settings is None else settings.steering_ratio

    def on_feedback(self, message: HandWheelFeedback) -> None:
        """Process who steers, and the ratio."""
        self.driver_steers = message.steered_by is not SteeredBy.LAW
        if message.steering_ratio >= 1.0:
            self._ratio = message.steering_ratio

    def steer_rad(self, state: HandWheelState) -> float:
        """Return the angle of the road wheels that the driver asks for."""
        return state.hand_wheel_angle_rad / self._ratio
