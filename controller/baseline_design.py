"""Parameters of the laws to compare with, from settings and filters already made discrete.

``controller.design`` makes the filters, and puts these together with them.
"""

from math import ceil

from controller.delayed_set_point import REQUESTS, REQUESTS_S_MIN, DelayedSetPointParams
from controller.feed_forward import SteadySteer
from controller.law_settings import (
    DelayedSetPointSettings,
    SmithSettings,
    VehicleModelSettings,
)
from controller.link import LinkParams
from controller.pd import PdParams
from controller.sections import Cascade2
from controller.smith import SmithParams


def steady_steer(vehicle: VehicleModelSettings, gain: float = 1.0) -> SteadySteer:
    """Return the steer per curvature of a vehicle, times a gain."""
    c_f, c_r = vehicle.front_cornering_stiffness_n_rad, vehicle.rear_cornering_stiffness_n_rad
    l_f, l_r = vehicle.front_axle_distance_m, vehicle.rear_axle_distance_m
    wheelbase_m = l_f + l_r
    understeer_s2_m = vehicle.virtual_mass_kg * (c_r * l_r - c_f * l_f) / (c_f * c_r * wheelbase_m)
    return SteadySteer(gain * wheelbase_m, gain * understeer_s2_m)


def smith_params(
    table: SmithSettings, pd: PdParams, compensation: Cascade2, period_s: float
) -> SmithParams:
    """Return the parameters of the Smith predictor; ``compensation`` is H G_n by Tustin's rule.

    Which takes a command to rise linearly over the period that it is in fact held for: its answer
    is half a period late. That half is already in the model's delay.
    """
    return SmithParams(pd, compensation, max(0.0, table.delay_s / period_s - 0.5))


def delayed_set_point_params(
    table: DelayedSetPointSettings,
    pd: PdParams,
    steady: SteadySteer,
    link: LinkParams,
    period_s: float,
    fade_step_rad: float,
) -> DelayedSetPointParams:
    """Return the parameters of the law with the delayed set point."""
    return DelayedSetPointParams(
        pd,
        steady,
        link,
        table.proportional_gain,
        table.integral_gain_1_s * period_s,
        -1.0 if table.delay_s is None else table.delay_s / period_s,
        float(max(1, ceil(REQUESTS_S_MIN / (period_s * REQUESTS)))),
        fade_step_rad,
    )
