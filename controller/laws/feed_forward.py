"""Curvature feed-forward from the map: adds to any law the steady-state steer of the curve.

    u = u_law + ρ (L + K_us V²)          K_us = m̃ (c_r l_r - c_f l_f)/(c_f c_r L)

    ρ     preview_curvature_1_m   of VEHICLE_STATE, where the lateral error is measured   [1/m]
    V     speed_m_s               of VEHICLE_STATE                                        [m/s]
    L     wheelbase_m             l_f + l_r                                               [m]
    K_us  understeer_s2_m         of the nominal vehicle                                  [s²/m]

This is the steady state of SAE 2018-01-1086 (1) on a circle. Not in paper. The map gives the
curvature at the present position, so the steer acts late by the latency of both directions. When
VEHICLE_STATE is stale the curve may be over: the steer fades out, and fades in when the message is
back.

An observer must not see this steer. Curve and feed-forward cancel each other, which leaves the
law's own part. From the whole command, the DOB of (9) would estimate the curve as a disturbance,
compensate it a second time, and leave the vehicle off its path by the feed-forward divided by
K_p. So the law receives only its own part of the command that was sent. (The Smith predictor reads
the whole command from the history, because it predicts the effect of all commands in transit.)
"""

from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from ...runtime.settings import Settings
from ..law_interface import LawInput, LawOutput, LawStep, VehicleReading
from ..limits.fades_and_ramps import NOTHING, Fading, fading_step


class FeedForwardSettings(Settings):
    """[feed_forward]: adds to any law the steady-state steer of the curve given by the map."""

    gain: Annotated[float, Field(ge=0.0, le=2.0)] = 1.0
    """Share of the nominal vehicle's steady-state steer."""


class SteadySteer(NamedTuple):
    """Steer per curvature, L + K_us V²."""

    wheelbase_m: float
    understeer_s2_m: float


class FeedForwardParams(NamedTuple):
    """Parameters of the law inside, and of the steer added to it.

    ``fade_step_rad``  largest step per period of the fading while VEHICLE_STATE is stale
    """

    law: Any
    steady: SteadySteer
    fade_step_rad: float


class FeedForwardState(NamedTuple):
    """State of the law inside, and the steer added to its last command."""

    law: Any
    curve: Fading


def steer_per_curvature(p: SteadySteer, speed_m_s: float) -> float:
    """Return the steer that a curvature of 1/m takes at a speed [rad m]."""
    return p.wheelbase_m + p.understeer_s2_m * speed_m_s * speed_m_s


def curve_steer(p: SteadySteer, vehicle: VehicleReading) -> float:
    """Return the steer that holds the curve the vehicle is in [rad]; 0 before it is known."""
    return vehicle.preview_curvature_1_m * steer_per_curvature(p, vehicle.speed_m_s)


def curve_step(p: SteadySteer, fade_step_rad: float, x: Fading, vehicle: VehicleReading) -> Fading:
    """Advance the steer for the curve by one period; it fades out while the message is stale."""
    wanted_rad = 0.0 if vehicle.is_stale else curve_steer(p, vehicle)
    return fading_step(fade_step_rad, x, wanted_rad, vehicle.is_stale)


def feed_forward_at_rest(
    law_at_rest: Callable[[float], Any], lateral_error_m: float
) -> FeedForwardState:
    """Return the state, with the law's, after a constant lateral error [m]; no curve known yet."""
    return FeedForwardState(law_at_rest(lateral_error_m), NOTHING)


def feed_forward_step(
    law_step: LawStep, p: FeedForwardParams, x: FeedForwardState, observed: LawInput
) -> tuple[FeedForwardState, LawOutput]:
    """Advance the inner law by one period with ``law_step``, and add the steer for the curve."""
    own_rad = observed.sent_steer_rad - x.curve.value
    own = LawInput(
        observed.lateral_error_m, own_rad, observed.vehicle, observed.loop_delay, observed.history
    )
    x_law, output = law_step(p.law, x.law, own)
    curve = curve_step(p.steady, p.fade_step_rad, x.curve, observed.vehicle)
    return FeedForwardState(x_law, curve), LawOutput(output.steer_rad + curve.value, *output[1:])
