"""The set point of the preview point that puts another point, the followed one, on the path.

The lateral error on the bus is that of the preview point, l_s ahead of the centre of gravity (CG).
Held on the path, it leaves the CG inside every bend. On a path of curvature ρ, a point p ahead of
the CG is on the path while the preview point is at

    y* = -ρ (d (β₁ + p) + d²/2)          d = l_s - p          β₁ = l_r - m̃ l_f V²/(c_r L)

    p    0 for the CG, -l_r for the rear axle, l_s for the preview point itself         [m]
    β₁   side slip per curvature in the steady state of SAE 2018-01-1086 (1)            [m]
    V    speed_m_s               of VEHICLE_STATE                                       [m/s]
    ρ    preview_curvature_1_m   of VEHICLE_STATE, at the preview point                 [1/m]

because there the vehicle points β₁ + p to the outside per curvature, and the path bends away from
its own tangent by d²/2 (p for the yaw rate that a turn takes). Not in paper.

The law sees y - y* as its lateral error. The terms belong to the path at the followed point and
d/3 ahead of it, not at the preview point. So y* follows ρ over a distance, first order, which
makes the two mean places equal: d - d³/(6 A) with A = d (l_r + p) + d²/2. When VEHICLE_STATE is
stale, y* fades out.

The predictor, which estimates the whole state, does without: its cost weights the deviation of the
followed point (``controller.prediction.gains_over_speed``). Only the law it falls back to sees
y - y*.
"""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

from ...runtime.fast_named_tuple import new_record
from ..filters.settings import VehicleModelSettings
from ..law_interface import LawInput, LawOutput, LawPlan, LawStep, VehicleReading
from ..limits.fades_and_ramps import FADE_M_S, NOTHING, Fading, fading_step

FollowedPoint = Literal["preview", "centre_of_gravity", "rear_axle"]
"""The point of the vehicle that a law holds on the path."""


class SetPoint(NamedTuple):
    """y* per curvature, -(A - B V²)."""

    geometric_m2: float
    by_tyres_s2: float


class SetPointParams(NamedTuple):
    """Parameters of y* over time.

    ``fade_step_m``  largest step per period of the fading while VEHICLE_STATE is stale
    """

    steady: SetPoint
    distance_m: float
    period_s: float
    fade_step_m: float


class SetPointState(NamedTuple):
    """y* before it fades [m], and y* as the law observes it."""

    value_m: float
    shown: Fading


class FollowedPointParams(NamedTuple):
    """Parameters of the law inside, and of its set point."""

    law: Any
    set_point: SetPointParams


class FollowedPointState(NamedTuple):
    """State of the law inside, and of its set point."""

    law: Any
    set_point: SetPointState


NO_SET_POINT = SetPointState(0.0, NOTHING)


def ahead_of_cg_m(point: FollowedPoint, vehicle: VehicleModelSettings) -> float:
    """Return p, how far a followed point lies ahead of the centre of gravity."""
    return {
        "preview": vehicle.preview_distance_m,
        "centre_of_gravity": 0.0,
        "rear_axle": -vehicle.rear_axle_distance_m,
    }[point]


def behind_preview_m(point: FollowedPoint, vehicle: VehicleModelSettings) -> float:
    """Return d; raises ValueError where the preview point is not ahead of the followed one."""
    d = vehicle.preview_distance_m - ahead_of_cg_m(point, vehicle)
    if d <= 0.0:
        raise ValueError("the followed point is the preview point itself")
    return d


def set_point_of(point: FollowedPoint, vehicle: VehicleModelSettings) -> SetPoint:
    """Return the set point of the preview point that puts another point on the path.

    Raises ValueError where the preview point is not ahead of it.
    """
    ahead_m, d = ahead_of_cg_m(point, vehicle), behind_preview_m(point, vehicle)
    l_f, l_r = vehicle.front_axle_distance_m, vehicle.rear_axle_distance_m
    c_r = vehicle.rear_cornering_stiffness_n_rad
    geometric_m2 = d * (l_r + ahead_m) + 0.5 * d * d
    by_tyres_s2 = d * vehicle.virtual_mass_kg * l_f / (c_r * (l_f + l_r))
    return SetPoint(geometric_m2, by_tyres_s2)


def set_point_params(
    point: FollowedPoint, vehicle: VehicleModelSettings, period_s: float
) -> SetPointParams:
    """Return the parameters of y* for a control period; raises as ``set_point_of``."""
    steady, d = set_point_of(point, vehicle), behind_preview_m(point, vehicle)
    distance_m = d - d * d * d / (6.0 * steady.geometric_m2)
    return SetPointParams(steady, distance_m, period_s, FADE_M_S * period_s)


def steady_set_point_m(p: SetPoint, vehicle: VehicleReading) -> float:
    """Return y* on a circle of the present curvature [m]."""
    geometric_m2, by_tyres_s2 = p
    speed_m_s = vehicle.speed_m_s
    per_curvature_m2 = geometric_m2 - by_tyres_s2 * speed_m_s * speed_m_s
    return -per_curvature_m2 * vehicle.preview_curvature_1_m


def set_point_step(p: SetPointParams, x: SetPointState, vehicle: VehicleReading) -> SetPointState:
    """Advance y* by one period."""
    value_m, shown = x
    is_stale, part = vehicle.is_stale, p.period_s * vehicle.speed_m_s / p.distance_m
    if part > 1.0:
        part = 1.0
    value_m = value_m + part * (steady_set_point_m(p.steady, vehicle) - value_m)
    wanted_m = 0.0 if is_stale else value_m
    after = fading_step(p.fade_step_m, shown, wanted_m, is_stale)
    return new_record(SetPointState, (value_m, after))


def followed_point_at_rest(
    law_at_rest: Callable[[float], Any], lateral_error_m: float
) -> FollowedPointState:
    """Return the state, with the law's, after a constant lateral error [m]; no curve known yet."""
    return FollowedPointState(law_at_rest(lateral_error_m), NO_SET_POINT)


def followed_point_after_hold(
    recovered: Callable[[Any, float], Any], x: FollowedPointState, lateral_error_m: float
) -> FollowedPointState:
    """Return the state after a hold, with the law's; the set point continues."""
    error_m = lateral_error_m - x.set_point.shown.value
    return FollowedPointState(recovered(x.law, error_m), x.set_point)


def followed_point_plan(
    law_plan: LawPlan, p: FollowedPointParams, x: FollowedPointState, observed: LawInput
) -> int:
    """Let the inner law write its plan, which knows no set point: its gains hold the point."""
    return law_plan(p.law, x.law, observed)


def followed_point_step(
    law_step: LawStep, p: FollowedPointParams, x: FollowedPointState, observed: LawInput
) -> tuple[FollowedPointState, LawOutput]:
    """Advance the inner law by one period with ``law_step``, on the error against its set point."""
    p_law, p_set_point = p
    x_law, set_point_before = x
    error_m, sent_rad, vehicle, loop_delay, history = observed
    set_point = set_point_step(p_set_point, set_point_before, vehicle)
    _, (shown_m, _, _) = set_point
    own = new_record(LawInput, (error_m - shown_m, sent_rad, vehicle, loop_delay, history))
    x_law, output = law_step(p_law, x_law, own)
    return new_record(FollowedPointState, (x_law, set_point)), output
