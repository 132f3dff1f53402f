"""Hand wheel: who steers, the law or the driver, and which angle the driver asks for.

The controller decides (HAND_WHEEL_FEEDBACK). Until it has, and once it has been silent for
SILENCE_NS, the driver steers. Both messages come through the latency of commands, and the angle
acts through the same guard as a command.
"""

from pydantic import Field

from ...dbc.messages import HandWheelFeedback, HandWheelState, SteeredBy
from ...runtime.settings import Settings

SILENCE_NS = 500_000_000
"""Chosen; the hand wheel waits as long."""


class HandWheelSettings(Settings):
    """`[hand_wheel]`: a hand wheel on the bus may steer."""

    steering_ratio: float = Field(16.0, ge=1.0, le=40.0)
    """Angle of the hand wheel over that of the road wheels, until HAND_WHEEL_FEEDBACK says it."""


class HandWheelLink:
    """Keeps what the controller said last."""

    def __init__(self, settings: HandWheelSettings) -> None:
        self._law_until_ns = 0
        self._ratio = settings.steering_ratio

    def driver_steers(self, now_ns: int) -> bool:
        """Whether HAND_WHEEL_STATE sets the target of the wheels, and no command."""
        return now_ns >= self._law_until_ns

    def on_feedback(self, message: HandWheelFeedback, now_ns: int) -> None:
        """Process who steers, and the ratio."""
        is_law = message.steered_by is SteeredBy.LAW
        self._law_until_ns = now_ns + SILENCE_NS if is_law else 0
        if message.steering_ratio >= 1.0:
            self._ratio = message.steering_ratio

    def steer_rad(self, state: HandWheelState) -> float:
        """Return the angle of the road wheels that the driver asks for."""
        return state.hand_wheel_angle_rad / self._ratio
