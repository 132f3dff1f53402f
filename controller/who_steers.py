"""[hand_wheel]: who steers, the law or the driver, where the car has a hand wheel.

    steered_by   the driver steers
    "driver"     always
    "law"        never
    "torque"     from a torque above the threshold on until his hands have been off for
                 ``hand_back_s``, and while the law cannot steer
    "both"       as "torque", but in place of the law both do: the road wheels follow the hand
                 wheel, and the law assists by a torque that turns it to the angle of the command

    T = K (i δ - θ) - D θ', limited, and faded in and out

    δ  command of the law   θ  angle of the hand wheel   i  steering ratio

A hand wheel that was never heard, or has fallen silent, steers nothing: then the law does.
"""

from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from ..dbc.messages import SteeredBy
from ..runtime.node import NS_PER_MS, NS_PER_S
from ..runtime.settings import Settings

_LAW, _DRIVER, _BOTH = int(SteeredBy.LAW), int(SteeredBy.DRIVER), int(SteeredBy.BOTH)
_BY_TORQUE = -1
_FADE_S = 0.5
"""From no assist to all of it: chosen."""
_Torque = Annotated[float, Field(ge=0.01, le=20.0)]


class HandWheelSettings(Settings):
    """`[hand_wheel]`; the defaults are chosen."""

    steered_by: Literal["driver", "law", "torque", "both"] = "torque"
    steering_ratio: float = Field(16.0, ge=1.0, le=40.0)
    """Angle of the hand wheel over that of the road wheels."""
    take_over_n_m: _Torque = 2.0
    """Torque of the driver, to either side, that takes over."""
    hands_off_n_m: _Torque = 0.3
    """Less is that of a hand that rests."""
    hand_back_s: float = Field(2.0, ge=0.0, le=60.0)
    timeout_ms: float = Field(100.0, ge=1.0, le=10_000.0)
    """A HAND_WHEEL_STATE older than this steers no more."""
    assist_n_m: float = Field(20.0, ge=0.0, le=1000.0)
    """K, per angle of the hand wheel [N m/rad]; D is the next."""
    assist_n_m_s: float = Field(1.0, ge=0.0, le=100.0)
    assist_n_m_max: float = Field(1.5, ge=0.0, le=20.0)
    """Below the torque that takes over, so that hands which rest do not."""


class SteeringRule(NamedTuple):
    """The settings, as numbers; who steers is the code of a ``SteeredBy``.

    ``always``  who steers whatever the torque; -1: the torque decides
    ``rested``  who steers while the driver rests
    ``ratio``, and below: the symbols above; ``step``: of the assist's share in a control period
    """

    always: int
    rested: int
    take_over_n_m: float
    hands_off_n_m: float
    hand_back_ns: int
    timeout_ns: int
    ratio: float
    gain_n_m: float
    damping_n_m_s: float
    torque_n_m_max: float
    step: float


class Steering(NamedTuple):
    """Who steers, when the driver's torque last was that of a hand [ns], and the assist's share.

    ``takes_over``  whether the law steers again from now on: it begins with the command sent last
    """

    steered_by: int
    held_ns: int
    share: float
    takes_over: bool = False


def steering_rule(table: HandWheelSettings, period_s: float) -> SteeringRule:
    """Return the rule of settings."""
    return SteeringRule(
        {"driver": _DRIVER, "law": _LAW}.get(table.steered_by, _BY_TORQUE),
        _BOTH if table.steered_by == "both" else _LAW,
        table.take_over_n_m,
        table.hands_off_n_m,
        round(table.hand_back_s * NS_PER_S),
        round(table.timeout_ms * NS_PER_MS),
        table.steering_ratio,
        table.assist_n_m,
        table.assist_n_m_s,
        table.assist_n_m_max,
        period_s / _FADE_S,
    )


def steering_step(
    p: SteeringRule, x: Steering, torque_n_m: float, age_ns: int, now_ns: int, can_steer: bool
) -> Steering:
    """Return who steers from ``now_ns`` on.

    ``torque_n_m``  of the driver, and ``age_ns`` of the message with it; NEVER_NS: there was none
    ``can_steer``   whether the law can
    """
    steered_by, held_ns = _who_steers(p, x, abs(torque_n_m), age_ns, now_ns, can_steer)
    share = min(x.share + p.step, 1.0) if steered_by == _BOTH else max(x.share - p.step, 0.0)
    takes_over = can_steer and steered_by == _LAW and x.steered_by != _LAW
    return Steering(steered_by, held_ns, share, takes_over)


def _who_steers(
    p: SteeringRule, x: Steering, torque_n_m: float, age_ns: int, now_ns: int, can_steer: bool
) -> tuple[int, int]:
    if age_ns > p.timeout_ns:
        return _LAW, now_ns
    if p.always != _BY_TORQUE:
        return p.always, now_ns
    if x.steered_by != _DRIVER:
        takes_over = torque_n_m >= p.take_over_n_m or not can_steer
        return (_DRIVER if takes_over else p.rested), now_ns
    if torque_n_m > p.hands_off_n_m:
        return _DRIVER, now_ns
    hands_back = can_steer and now_ns - x.held_ns >= p.hand_back_ns
    return (p.rested, now_ns) if hands_back else (_DRIVER, x.held_ns)


def assist_n_m(
    p: SteeringRule, x: Steering, wanted_rad: float, angle_rad: float, rate_rad_s: float
) -> float:
    """Return the torque of the law on the hand wheel, to the left positive.

    ``wanted_rad``  its command
    ``angle_rad``   of the hand wheel, and its rate ``rate_rad_s``
    """
    lack_rad = p.ratio * wanted_rad - angle_rad if x.steered_by == _BOTH else 0.0
    torque_n_m = p.gain_n_m * lack_rad - p.damping_n_m_s * rate_rad_s
    return x.share * min(max(torque_n_m, -p.torque_n_m_max), p.torque_n_m_max)
