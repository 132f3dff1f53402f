"""Settings table `[safety]`, and the guard designed from it."""

import math
from enum import StrEnum
from typing import Annotated, Literal, TypeVar

from pydantic import Field, Tag

from ...dbc.messages import SteeringCommand, limits
from ...dbc.reception import SecondSenderAction
from ...runtime.node import NS_PER_MS, NS_PER_S
from ...runtime.settings import NUMBER_OR_WORD, OffWord, Settings
from ..vehicle.settings import ActuatorSettings, VehicleSettings
from ..vehicle.steady_turn import acceleration_gain_m_s2
from .hold_and_fallback import OFF_NS, RAMP_PERIOD_NS, GuardParams
from .safety_limiter import LimiterParams, limit_table

OFF: Literal["off"] = "off"
_N = TypeVar("_N")
_OrOff = Annotated[Annotated[_N, Tag("number")] | OffWord, NUMBER_OR_WORD]
Limit = float | Literal["off"]
"""A limit; "off" for none, because TOML has no null."""
_STEER_RAD_MAX = limits(SteeringCommand)["steer_rad"].maximum
"""The largest command that the bus can carry."""
_LAGS_TO_SETTLE = 3.0
_PATH_S, _PATH_M_MIN = 0.4, 3.0
"""Length of the law along the path, as time at the vehicle's speed beyond twice the actuator's lag
and dead time, and the least; chosen."""
_REPORTING_NS = 10_000_000
"""What is left of the FTTI when silence is detected: the next STEERING_STATUS, which reports it,
comes within a sensor period, and a tick may be late."""


class Fallback(StrEnum):
    """The wheel's target when commands are missing."""

    KEEP = "keep"
    RAMP_TO_ZERO = "ramp_to_zero"
    """At speed in a bend a hazard: it leads the car off the road."""
    FOLLOW_PATH = "follow_path"
    """The steering unit follows the path by itself, as its sensors read it."""


class SafetySettings(Settings):
    """`[safety]`: limits of the steering for any command; "off" switches one off.

    At walking speed the default limits pass everything within ± 0.6 rad: with the default vehicle,
    both rate limits allow more than 1.2 rad at once up to 8.8 km/h.
    """

    angle_rad_max: _OrOff[Annotated[float, Field(ge=0.01, le=1.5)]] = 0.7
    angle_rate_rad_s_max: _OrOff[Annotated[float, Field(ge=0.01, le=100.0)]] = 2.5
    """Averaged over half a second, like the jerk."""
    lateral_acceleration_m_s2_max: _OrOff[Annotated[float, Field(ge=0.1, le=50.0)]] = 3.0
    """ISO 11270."""
    lateral_jerk_m_s3_max: _OrOff[Annotated[float, Field(ge=0.1, le=1000.0)]] = 5.0
    """ISO 11270: the moving average over half a second."""
    follow_tolerance_rad: _OrOff[Annotated[float, Field(ge=0.001, le=1.0)]] = 0.1
    """Between the wheel and its target."""
    follow_time_ms: float = Field(100.0, ge=1.0, le=10_000.0)
    """Longest time that the wheel may be further away, beyond what an intact actuator needs."""
    ftti_ms: _OrOff[Annotated[float, Field(ge=20.0, le=10_000.0)]] = 150.0
    """Fault tolerant time interval, for the reaction to silence and its report. 150 is chosen: no
    rule gives a number, it follows from road and speed (``steer-by-wire study fault_time``)."""
    hold_ms: float = Field(500.0, ge=0.0, le=60_000.0)
    """How long the last command is held in silence before the fallback."""
    plan_ms_max: float = Field(300.0, ge=0.0, le=10_000.0)
    """How long a plan is played after it has come, also in silence, but not in the fallback."""
    fallback: Fallback = Fallback.RAMP_TO_ZERO
    stop_m_s2: float | None = Field(None, ge=0.1, le=10.0)
    """Braking of a car to a stop during the fallback; if omitted, it drives on."""
    ramp_rad_s: float = Field(0.2, ge=0.001, le=10.0)
    """Of the fallback, and of the fade after a silence."""
    recovery_frames: int = Field(5, ge=1, le=100)
    """Commands in a row that end the hold or the fallback."""
    second_sender: SecondSenderAction = "report"
    """"silent": while there is a second sender, and for a second, no command is followed."""
    override_at_s: float | None = Field(None, ge=0.0, le=1e6)
    """Time of motion at which the safe state is forced."""


def design_guard(
    settings: SafetySettings, vehicle: VehicleSettings, actuator: ActuatorSettings
) -> GuardParams:
    """Return the guard of a run."""
    gain_m_s2 = acceleration_gain_m_s2(vehicle)
    table = limit_table(
        gain_m_s2,
        _bound(settings.angle_rad_max),
        _bound(settings.angle_rate_rad_s_max),
        _bound(settings.lateral_acceleration_m_s2_max),
        _bound(settings.lateral_jerk_m_s3_max),
    )
    stop_rad = math.inf if actuator.angle_limit_rad is None else actuator.angle_limit_rad
    follow_s = settings.follow_time_ms * 1e-3 + _settling_s(actuator, min(_STEER_RAD_MAX, stop_rad))
    ramp_step_rad = settings.ramp_rad_s * RAMP_PERIOD_NS / NS_PER_S
    follows_path = settings.fallback is Fallback.FOLLOW_PATH
    path_s = _PATH_S + 2.0 * (actuator.lag_s + actuator.dead_time_s)
    override_s = settings.override_at_s
    return GuardParams(
        limiter=LimiterParams(
            table=table,
            tolerance_rad=_bound(settings.follow_tolerance_rad),
            follow_ns=round(follow_s * NS_PER_S),
            stop_rad=stop_rad,
        ),
        silence_ns=_silence_ns(settings.ftti_ms),
        plan_ns=round(settings.plan_ms_max * NS_PER_MS),
        hold_ns=round(settings.hold_ms * NS_PER_MS),
        recovery_frames=settings.recovery_frames,
        ramp_rad_s=settings.ramp_rad_s,
        ramp_step_rad=ramp_step_rad if settings.fallback is Fallback.RAMP_TO_ZERO else 0.0,
        override_ns=OFF_NS if override_s is None else round(override_s * NS_PER_S),
        path_m=vehicle.speed_m_s**2 / gain_m_s2 if follows_path else 0.0,
        path_1_m=1.0 / max(vehicle.speed_m_s * path_s, _PATH_M_MIN),
    )


def resync_ns_of(settings: SafetySettings) -> int:
    """Return the silence after which a restart of the commands' sender is accepted [ns].

    It is longer than the silence before HOLDING; 0 if that is off.
    """
    silence_ns = _silence_ns(settings.ftti_ms)
    return 0 if silence_ns == OFF_NS else silence_ns + 1


def _silence_ns(ftti_ms: Limit) -> int:
    if ftti_ms == OFF:
        return OFF_NS
    return round(ftti_ms * NS_PER_MS) - _REPORTING_NS


def _bound(limit: Limit) -> float:
    return math.inf if limit == OFF else limit


def _settling_s(actuator: ActuatorSettings, reach_rad: float) -> float:
    rate_rad_s = actuator.rate_limit_rad_s
    ramp_s = 0.0 if rate_rad_s is None else 2.0 * reach_rad / rate_rad_s
    return ramp_s + _LAGS_TO_SETTLE * actuator.lag_s + actuator.dead_time_s
