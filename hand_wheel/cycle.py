"""One cycle of the hand wheel: what hands and motor do until the next cycle.

    u = share (law or servo) + order + (1 - share) local damping

The node and the compiled run share this step. While the controller's law steers, the servo lets the
wheel follow the road wheels, and the order is the torque that the controller adds.
"""

from math import isfinite
from typing import NamedTuple

from ..dbc.messages import Mode
from .driver import DRIVER_AT_REST, HANDS_OFF, DriverParams, DriverState, Sight, driver_step
from .feedback_laws import (
    FEEDBACK_AT_REST,
    FeedbackInput,
    FeedbackParams,
    FeedbackState,
    feedback_step,
    resist,
)
from .wheel_step import Hands, WheelState

_ACTIVE, _HOLDING = int(Mode.ACTIVE), int(Mode.HOLDING)


class CycleParams(NamedTuple):
    """Constants of driver and law; ``law`` is the place of the law in FEEDBACK_LAWS."""

    driver: DriverParams
    feedback: FeedbackParams
    law: int
    servo_n_m: float
    servo_n_m_s: float
    fallback_damping_n_m_s: float


class CycleState(NamedTuple):
    """State of driver and law, and what hands and motor do until the next cycle.

    ``law_n_m``   newest torque of the law, and ``told_n_m`` what the motor is told
    """

    driver: DriverState
    feedback: FeedbackState
    law_n_m: float
    hands: Hands
    told_n_m: float


class CycleInput(NamedTuple):
    """What is known when a cycle begins.

    ``late_rad``   angle that the driver wished by sight, a reaction time ago
    ``holds``      whether the driver's hands are on the wheel
    ``drives``     whether the driver steers, alone or together with the law
    ``wheel_rad``  angle of the road wheels
    ``mode``       Mode, as a number; ``share`` is the law's share of the torque
    """

    late_rad: float
    sight: Sight
    kick_n_m: float
    holds: bool
    drives: bool
    wheel: WheelState
    rack_force_n: float
    wheel_rad: float
    ratio: float
    order_n_m: float
    mode: int
    share: float


def own_motion(
    angle_rad: float, hands: Hands, driver_alone: bool, followed_rad: float, curvature_1_m: float
) -> tuple[float, float]:
    """Return the wheel's angle less the one that it is meant to have, and the path it follows.

    It is meant to have ``followed_rad``, or the angle that a driver who steers alone wishes. If he
    wishes none, it follows no path: the curvature is 0.
    """
    if not driver_alone:
        return angle_rad - followed_rad, curvature_1_m
    wished_rad = hands.wished_rad if hands.grip.stiffness_n_m != 0.0 else 0.0
    return angle_rad - wished_rad, curvature_1_m if wished_rad != 0.0 else 0.0


CYCLE_AT_REST = CycleState(
    DRIVER_AT_REST, FEEDBACK_AT_REST, 0.0, Hands(HANDS_OFF, 0.0, 0.0, 0.0), 0.0
)


def cycle_step(p: CycleParams, x: CycleState, u: CycleInput) -> CycleState:
    """Return the state a cycle later."""
    angle_rad, rate_rad_s, _, driver_n_m, _, _ = u.wheel
    observed = FeedbackInput(angle_rad, rate_rad_s, u.rack_force_n, u.wheel_rad, driver_n_m)
    driver, hands = driver_step(
        p.driver, x.driver, u.late_rad, u.sight, angle_rad, u.kick_n_m, u.holds, u.drives
    )
    feedback, law_n_m, share = x.feedback, x.law_n_m, u.share
    if share > 0.0 or u.mode == _ACTIVE or u.mode == _HOLDING:
        feedback, against_n_m = feedback_step(p.law, p.feedback, feedback, observed)
        feedback, law_n_m = resist(p.feedback, feedback, against_n_m, rate_rad_s)
    felt_n_m = law_n_m
    if not u.drives:
        lack_rad = u.ratio * u.wheel_rad - angle_rad
        felt_n_m = p.servo_n_m * lack_rad - p.servo_n_m_s * rate_rad_s
    local_n_m = -p.fallback_damping_n_m_s * rate_rad_s
    told_n_m = share * felt_n_m + u.order_n_m + (1.0 - share) * local_n_m
    told_n_m = told_n_m if isfinite(told_n_m) else local_n_m
    return CycleState(driver, feedback, law_n_m, hands, told_n_m)
