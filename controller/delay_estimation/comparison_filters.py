"""The filters that make command, lateral error and yaw rate comparable, designed at one speed.

Yaw rate: the vehicle turns because it is steered, whatever the path.

    x_b = W G_r u        W = s/(s + ω_w) · ω_l²/(s + ω_l)²        G_r wheel angle to yaw rate
    z_b = W r

Network disturbance: that of the communication disturbance observer (``controller.filters.cdob``),
without the effect of the path's curvature ρ on the lateral error, which by (5) is -V²/s²:

    d̂_n = Q (u - (y + (V²/s²) ρ)/G_n)
    w = H G_n d̂_n = x_a - z_a               its compensation, H = (s/(s + ω_h))²
    x_a = Q H G_n u
    z_a = Q (H y + V²/(s + ω_h)² ρ)

With a network delay T, w = x_a(t) - x_a(t - T), so that z_a = x_a(t - T). In this form nothing is
divided by G_n, and stable poles of the vehicle suffice at any speed.
"""

from collections.abc import Sequence
from operator import add
from typing import NamedTuple

from ..filters.discretization import tustin_sections
from ..filters.nominal_model import NominalVehicle, steer_to_lateral_error
from ..filters.sections import (
    Cascade2,
    Cascade2State,
    Cascade3,
    Cascade3State,
    Section,
    SectionState,
    cascade_2_at_rest,
    cascade_2_run,
    cascade_3_at_rest,
    cascade_3_run,
    section_at_rest,
    section_run,
)
from ..filters.transfer_function import Factor, TransferFunction

YAW_WASHOUT_RAD_S = 0.15
YAW_LOWPASS_RAD_S = 8.0
ERROR_WASHOUT_RAD_S = 0.8
ERROR_LOWPASS_RAD_S = 15.0
_SPEED_CHANGE = 0.05
"""Relative change of the speed at which the filters are designed anew."""


class DelayFilters(NamedTuple):
    """Discrete filters by Tustin, for a vehicle at one speed.

    ``lag_s``  the vehicle's own lag of the yaw rate behind a slow steer [s]
    """

    command_to_yaw: Cascade3
    yaw: Cascade2
    command_to_error: Cascade3
    error: Section
    curvature: Section
    error_lowpass: Section
    lag_s: float


FilterStates = tuple[
    Cascade3State, Cascade2State, Cascade3State, SectionState, SectionState, SectionState
]
"""States of the filters, in their order."""


def is_another_speed(speed_m_s: float, designed_m_s: float) -> bool:
    """Whether filters that were designed at one speed have to be designed anew at another."""
    return abs(speed_m_s - designed_m_s) > _SPEED_CHANGE * designed_m_s


def design_filters(vehicle: NominalVehicle, period_s: float) -> DelayFilters | None:
    """Return the filters of a vehicle at its speed, None where it is unstable there."""
    plant = steer_to_lateral_error(vehicle)
    (poles,) = plant.denominator
    if not poles.hurwitz:
        return None
    turn = _steer_to_yaw(vehicle, poles)
    nyquist_rad_s = 3.0 / period_s
    yaw_lowpass = _lowpass(min(YAW_LOWPASS_RAD_S, 0.5 * nyquist_rad_s))
    error_lowpass = _lowpass(min(ERROR_LOWPASS_RAD_S, 0.5 * nyquist_rad_s))
    # s/(s + ω) as a quotient of factors: a lone s has no place among the powers of s².
    w = YAW_WASHOUT_RAD_S
    washout = _section(Factor(0.0, 1.0, 0.0), Factor(0.0, 1.0, w), period_s)
    h = ERROR_WASHOUT_RAD_S
    slow = Factor(1.0, 2.0 * h, h * h)
    highpass = TransferFunction(2, (), (slow,))
    v = vehicle.speed_m_s
    drift = TransferFunction(0, (Factor(0.0, 0.0, v * v),), (slow,))
    (yaw_filter,) = tustin_sections(yaw_lowpass, period_s)
    (turn_filter,) = tustin_sections(turn, period_s)
    (error_filter,) = tustin_sections(highpass, period_s)
    (drift_filter,) = tustin_sections(drift, period_s)
    (low,) = tustin_sections(error_lowpass, period_s)
    first, second = tustin_sections(highpass.times(plant), period_s)
    (gain,) = turn.numerator
    return DelayFilters(
        command_to_yaw=(turn_filter, yaw_filter, washout),
        yaw=(yaw_filter, washout),
        command_to_error=(first, second, low),
        error=error_filter,
        curvature=drift_filter,
        error_lowpass=low,
        lag_s=poles.s1 / poles.s0 - gain.s1 / gain.s0,
    )


def filters_at_rest(p: DelayFilters, yaw_rate_rad_s: float, lateral_error_m: float) -> FilterStates:
    """Return the states at a constant yaw rate and lateral error, and zero for all else."""
    return (
        cascade_3_at_rest(p.command_to_yaw, 0.0)[0],
        cascade_2_at_rest(p.yaw, yaw_rate_rad_s)[0],
        cascade_3_at_rest(p.command_to_error, 0.0)[0],
        section_at_rest(p.error, lateral_error_m)[0],
        section_at_rest(p.curvature, 0.0)[0],
        section_at_rest(p.error_lowpass, 0.0)[0],
    )


def filters_run(
    p: DelayFilters,
    x: FilterStates,
    commands_rad: Sequence[float],
    yaw_rates_rad_s: Sequence[float],
    lateral_errors_m: Sequence[float],
    curvatures_1_m: Sequence[float],
) -> tuple[FilterStates, Sequence[Sequence[float]]]:
    """Advance by a period per value; returns the new states, and x_a, z_a, x_b, z_b."""
    x_yaw, z_yaw, x_error, z_error, z_curvature, z_low = x
    x_yaw, x_b = cascade_3_run(p.command_to_yaw, x_yaw, commands_rad)
    z_yaw, z_b = cascade_2_run(p.yaw, z_yaw, yaw_rates_rad_s)
    x_error, x_a = cascade_3_run(p.command_to_error, x_error, commands_rad)
    z_error, swings_m = section_run(p.error, z_error, lateral_errors_m)
    z_curvature, drifts_m = section_run(p.curvature, z_curvature, curvatures_1_m)
    z_low, z_a = section_run(p.error_lowpass, z_low, map(add, swings_m, drifts_m))
    return (x_yaw, z_yaw, x_error, z_error, z_curvature, z_low), (x_a, z_a, x_b, z_b)


def _steer_to_yaw(vehicle: NominalVehicle, poles: Factor) -> TransferFunction:
    """Return r/δ of (1): (b21 s + a21 b11 - a11 b21)/D(s)."""
    m, j, c_f, c_r, l_f, l_r, _, v = vehicle
    a11 = -(c_r + c_f) / (m * v)
    a21 = (c_r * l_r - c_f * l_f) / j
    b11, b21 = c_f / (m * v), c_f * l_f / j
    return TransferFunction(0, (Factor(0.0, b21, a21 * b11 - a11 * b21),), (poles,))


def _lowpass(omega_rad_s: float) -> TransferFunction:
    """Return ω²/(s + ω)²."""
    tau_s = 1.0 / omega_rad_s
    return TransferFunction(0, (), (Factor(tau_s * tau_s, 2.0 * tau_s, 1.0),))


def _section(zeros: Factor, poles: Factor, period_s: float) -> Section:
    (section,) = tustin_sections(TransferFunction(0, (zeros,), (poles,)), period_s)
    return section
