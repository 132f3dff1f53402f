"""[hand_wheel]: who steers, the law or the driver, where the car has a hand wheel.

    steered_by   the driver steers
    "driver"     always
    "law"        never
    "torque"     from a torque above the threshold on until his hands have been off for
                 ``hand_back_s``, and while the law cannot steer

A hand wheel that was never heard, or has fallen silent, steers nothing: then the law does.
"""

from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from ..dbc.messages import SteeredBy
from ..runtime.node import NS_PER_MS, NS_PER_S
from ..runtime.settings import Settings

_LAW, _DRIVER = SteeredBy.LAW, SteeredBy.DRIVER
_Torque = Annotated[float, Field(ge=0.01, le=20.0)]


class HandWheelSettings(Settings):
    """`[hand_wheel]`; the defaults are chosen."""

    steered_by: Literal["driver", "law", "torque"] = "torque"
    steering_ratio: float = Field(16.0, ge=1.0, le=40.0)
    """Angle of the hand wheel over that of the road wheels."""
    take_over_n_m: _Torque = 2.0
    """Torque of the driver, to either side, that takes over."""
    hands_off_n_m: _Torque = 0.3
    """Less is that of a hand that rests."""
    hand_back_s: float = Field(2.0, ge=0.0, le=60.0)
    timeout_ms: float = Field(100.0, ge=1.0, le=10_000.0)
    """A HAND_WHEEL_STATE older than this steers no more."""


class SteeringRule(NamedTuple):
    """The settings, as numbers; ``always`` is who steers whatever the torque, or None."""

    always: SteeredBy | None
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
    always = {"driver": _DRIVER, "law": _LAW, "torque": None}[table.steered_by]
    return SteeringRule(
        always,
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
    if x.steered_by is _LAW:
        takes_over = torque_n_m >= p.take_over_n_m or not can_steer
        return Steering(_DRIVER if takes_over else _LAW, now_ns)
    if torque_n_m > p.hands_off_n_m:
        return Steering(_DRIVER, now_ns)
    hands_back = can_steer and now_ns - x.held_ns >= p.hand_back_ns
    return Steering(_LAW, now_ns) if hands_back else x
