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

_LAW, _DRIVER, _BOTH = SteeredBy.LAW, SteeredBy.DRIVER, SteeredBy.BOTH
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
    """The settings, as numbers; ``always`` is who steers whatever the torque, or None.

    ``rested``  who steers while the driver rests
    """

    always: SteeredBy | None
    rested: SteeredBy
    take_over_n_m: float
    hands_off_n_m: float
    hand_back_ns: int
    timeout_ns: int


class Steering(NamedTuple):
    """Who steers, and when his torque last was that of a hand [ns]."""

    steered_by: SteeredBy
    held_ns: int


def steering_rule(table: HandWheelSettings) -> SteeringRule:
    """Return the rule of settings."""
    always = {"driver": _DRIVER, "law": _LAW}.get(table.steered_by)
    return SteeringRule(
        always,
        _BOTH if table.steered_by == "both" else _LAW,
        table.take_over_n_m,
        table.hands_off_n_m,
        round(table.hand_back_s * NS_PER_S),
        round(table.timeout_ms * NS_PER_MS),
    )


def steering_step(
    p: SteeringRule, x: Steering, heard: tuple[float, int | None], now_ns: int, *, can_steer: bool
) -> Steering:
    """Return who steers from ``now_ns`` on.

    ``heard``      torque of the driver [N m], and age of the message with it; None: there was none
    ``can_steer``  whether the law can
    """
    torque_n_m, age_ns = heard
    if age_ns is None or age_ns > p.timeout_ns:
        return Steering(_LAW, now_ns)
    if p.always is not None:
        return Steering(p.always, now_ns)
    torque_n_m = abs(torque_n_m)
    if x.steered_by is not _DRIVER:
        takes_over = torque_n_m >= p.take_over_n_m or not can_steer
        return Steering(_DRIVER if takes_over else p.rested, now_ns)
    if torque_n_m > p.hands_off_n_m:
        return Steering(_DRIVER, now_ns)
    hands_back = can_steer and now_ns - x.held_ns >= p.hand_back_ns
    return Steering(p.rested, now_ns) if hands_back else x


def assist_step(
    p: HandWheelSettings,
    share: float,
    wanted_rad: float | None,
    wheel: tuple[float, float],
    period_s: float,
) -> tuple[float, float]:
    """Return share and torque of the law on the hand wheel [N m], to the left positive.

    ``wanted_rad``  command of the law; None where it does not assist
    ``wheel``       angle and rate of the hand wheel
    """
    angle_rad, rate_rad_s = wheel
    step = period_s / _FADE_S
    share = max(share - step, 0.0) if wanted_rad is None else min(share + step, 1.0)
    lack_rad = 0.0 if wanted_rad is None else p.steering_ratio * wanted_rad - angle_rad
    torque_n_m = p.assist_n_m * lack_rad - p.assist_n_m_s * rate_rad_s
    return share, share * min(max(torque_n_m, -p.assist_n_m_max), p.assist_n_m_max)
