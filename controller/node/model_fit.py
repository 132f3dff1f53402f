"""Fit of the vehicle to the box of [validity]: its yaw rate against that of the box's ends.

A wheel angle δ that is held makes the yaw rate r = V δ/(L + K V²), with the understeer gradient

    K = m/L (l_r/c_f - l_f/c_r)

so that mass, tyres and friction show as one number. The corners of the box with the least and the
largest K have yaw rates r_least and r_largest, and the measured one is

    r = r_least + w (r_largest - r_least) + b

Within the box the share w is from 0 to 1. A Kalman filter finds w and the bias b, which is that of
an offset or of a side wind; its noise is what the equation has left so far. The vehicle does not
fit if w has been outside by more than MARGIN and by more than DEVIATIONS of its deviation for
DEBOUNCE_S: (w - w_box)²/var(w), the squared innovations that the best share in the box costs more
than the best of all, is chi-square of one degree of freedom for a vehicle at the box's end.

K V² is small against L at walking speed: every vehicle of the box moves there as its wheelbase
says, and none is refused. The fit is judged where the box's ends differ by WIDTH_MIN in yaw rate,
and while the deviation of w is at most DEVIATION_MAX. Where the wheel turns little, an offset or a
side wind, which the controller steers against, moves w by more than its deviation says.
"""

from math import sqrt
from typing import Any, NamedTuple

from ..filters.nominal_model import NominalVehicle, understeer_gradient_s2_m
from ..limits.designed_ranges import ValiditySettings
from ..prediction.regression import Coefficients, regressed
from ..settings import ControllerSettings
from .plausibility import nominal_vehicle

COMPARED = frozenset({"yaw_rate_rad_s", "wheel_angle_rad", "speed_m_s"})
"""The plant's signals without any of which nothing can be said."""
DEVIATIONS = 3.0
MARGIN = 0.03
"""Of the width of the box: the yaw rate of a wheel that turns differs from a held one's."""
DEVIATION_MAX = 0.1
"""Without this ``tests.searches.ordinary_runs`` counts 8 false alarms in 182 runs of the highway
laws, at deviations from 0.16."""
DEBOUNCE_S = 3.0
WIDTH_MIN = 0.05
_DEVIATION_KNOWN_MAX = 0.2
_SMOOTHED_S = 0.3
"""Faster, the yaw rate follows the wheel less than a held one."""
_NOISE_FORGETS_S = 20.0
_NOISE_RAD2_S2_MIN = 5e-4**2
_TIMING = 0.25
"""Of a step's change of the yaw rate: wheel angle and yaw rate come at times of their own."""
_TRANSIENT = 0.03
"""Of the yaw rate: how it follows a wheel that turns differs from one vehicle to the other."""
_W_WALKS_PER_S, _B_WALKS_PER_S = 1e-4, 2.5e-5
"""Variance that w and b [rad²/s²] gain in a second."""
_W_VARIANCE_MAX, _B_VARIANCE_MAX = 25.0, 0.01
_LAG_S_MIN = 1e-3
_LOG_2 = 0.6931471805599453
_NEGLIGIBLE = -700.0
_NARROWEST_S2_M = 1e-4
"""A box of no width in K gets this one: 0.03 m of L + K V² at 60 km/h."""


def gradients_s2_m(vehicle: NominalVehicle, box: ValiditySettings) -> tuple[float, float]:
    """Return the least and the largest K of a box around a nominal vehicle."""
    gradients = [understeer_gradient_s2_m(corner) for corner in box.corners(vehicle)]
    least, largest = min(gradients), max(gradients)
    if largest - least < _NARROWEST_S2_M:
        return least - 0.5 * _NARROWEST_S2_M, largest + 0.5 * _NARROWEST_S2_M
    return least, largest


class FitParams(NamedTuple):
    """The box: its wheelbase, least and largest K, and the nominal vehicle."""

    length_m: float
    least_s2_m: float
    largest_s2_m: float
    vehicle: NominalVehicle


def fit_params(settings: ControllerSettings) -> FitParams | None:
    """Return the parameters; None where the settings state no vehicle or no box."""
    vehicle, box = nominal_vehicle(settings), settings.validity
    if vehicle is None or box is None:
        return None
    length_m = vehicle.front_axle_distance_m + vehicle.rear_axle_distance_m
    return FitParams(length_m, *gradients_s2_m(vehicle, box), vehicle)


class FitState(NamedTuple):
    """State of the fit.

    ``late_rad``, ``wheel_rad``, ``yaw_rate_rad_s``  the means so far, smoothed
    ``share``        w, b and their variances
    ``least_rad_s``  r_least, ``left_rad2_s2``: the noise
    ``yaw_lag_s``    at ``speed_m_s``
    ``lasted_s``     how long the share has contradicted ``fits``
    ``fits``         whether the vehicle is in the box, as far as is known
    """

    late_rad: float
    wheel_rad: float
    yaw_rate_rad_s: float
    share: Coefficients
    least_rad_s: float
    left_rad2_s2: float
    steps: float
    speed_m_s: float
    yaw_lag_s: float
    lasted_s: float
    fits: bool


def start_fit() -> FitState:
    """Return the state of a vehicle of which nothing is known."""
    return FitState(
        0.0, 0.0, 0.0, (0.5, 0.0, _W_VARIANCE_MAX, 0.0, _B_VARIANCE_MAX),
        0.0, 0.0, 0.0, 0.0, 1.0, 0.0, True,
    )  # fmt: skip


def fit_step(
    p: FitParams, x: FitState, lasted_s: float, v: float, yaw_rate_rad_s: float, wheel_rad: float
) -> FitState:
    """Take the means of speed, yaw rate and wheel angle since the last step, ``lasted_s`` ago."""
    yaw_lag_s = x.yaw_lag_s if v == x.speed_m_s else lag_s(p.vehicle, v)
    v2 = v * v
    least_m, largest_m = p.length_m + p.least_s2_m * v2, p.length_m + p.largest_s2_m * v2
    if yaw_lag_s == 0.0 or least_m == 0.0 or largest_m == 0.0:
        return x
    # The yaw rate follows a turning wheel late, by about this.
    late_rad = x.late_rad + (1.0 - decay(-lasted_s / yaw_lag_s)) * (wheel_rad - x.late_rad)
    taken = 1.0 - decay(-lasted_s / _SMOOTHED_S)
    smooth_rad = x.wheel_rad + taken * (late_rad - x.wheel_rad)
    r = x.yaw_rate_rad_s + taken * (yaw_rate_rad_s - x.yaw_rate_rad_s)
    least_rad_s, largest_rad_s = v * smooth_rad / least_m, v * smooth_rad / largest_m
    timing_rad_s = _TIMING * (least_rad_s - x.least_rad_s)
    transient_rad_s = _TRANSIENT * least_rad_s
    uncertain_rad2_s2 = timing_rad_s * timing_rad_s + transient_rad_s * transient_rad_s
    noise_rad2_s2 = max(x.left_rad2_s2, _NOISE_RAD2_S2_MIN) + uncertain_rad2_s2
    width_rad_s, over_rad_s = largest_rad_s - least_rad_s, r - least_rad_s
    before = walked(x.share, lasted_s)
    share = regressed(before, width_rad_s, 1.0, over_rad_s, noise_rad2_s2)
    left_rad_s = over_rad_s - share[0] * width_rad_s - share[1]
    steps = x.steps + 1.0
    if steps == 0.0:
        return x
    weight = max(1.0 / steps, min(lasted_s / _NOISE_FORGETS_S, 1.0))
    left_rad2_s2 = x.left_rad2_s2 + weight * (left_rad_s * left_rad_s - x.left_rad2_s2)
    is_wide = abs(width_rad_s) >= WIDTH_MIN * abs(least_rad_s)
    fits, beyond_s = x.fits, x.lasted_s
    if is_wide and share[2] <= DEVIATION_MAX * DEVIATION_MAX:
        beyond_s = beyond_s + lasted_s if is_outside(share) == fits else 0.0
        if beyond_s >= DEBOUNCE_S:
            fits, beyond_s = not x.fits, 0.0
    return FitState(
        late_rad, smooth_rad, r, share, least_rad_s, left_rad2_s2, steps, v, yaw_lag_s,
        beyond_s, fits,
    )  # fmt: skip


def walked(share: Coefficients, lasted_s: float) -> Coefficients:
    """Return w and b with the variances that they have gained."""
    w, b, p_ww, p_wb, p_bb = share
    walked_ww = min(p_ww + _W_WALKS_PER_S * lasted_s, _W_VARIANCE_MAX)
    walked_bb = min(p_bb + _B_WALKS_PER_S * lasted_s, _B_VARIANCE_MAX)
    return w, b, walked_ww, p_wb, walked_bb


def is_outside(share: Coefficients) -> bool:
    """Whether a share is outside the box, for certain."""
    over = max(share[0] - 1.0, -share[0]) - MARGIN
    return over > 0.0 and over * over > DEVIATIONS * DEVIATIONS * share[2]


def lag_s(p: NominalVehicle, speed_m_s: float) -> float:
    """Return the lag of the yaw rate behind a turning wheel."""
    m, j = p.virtual_mass_kg, p.yaw_inertia_kg_m2
    c_f, l_f = p.front_cornering_stiffness_n_rad, p.front_axle_distance_m
    c_r, l_r = p.rear_cornering_stiffness_n_rad, p.rear_axle_distance_m
    v = max(speed_m_s, 0.1)
    m_v, m_v2, j_v = m * v, m * v * v, j * v
    if m_v == 0.0 or m_v2 == 0.0 or j_v == 0.0 or j == 0.0:
        return _LAG_S_MIN
    a_11, a_12 = -(c_r + c_f) / m_v, -1.0 + (c_r * l_r - c_f * l_f) / m_v2
    a_21, a_22 = (c_r * l_r - c_f * l_f) / j, -(c_r * (l_r * l_r) + c_f * (l_f * l_f)) / j_v
    b_1, b_2 = c_f / m_v, c_f * l_f / j
    gain, determinant = a_21 * b_1 - a_11 * b_2, a_11 * a_22 - a_12 * a_21
    if gain == 0.0 or determinant == 0.0:
        return _LAG_S_MIN
    return max(-(a_11 + a_22) / determinant - b_2 / gain, _LAG_S_MIN)


def decay(x: float) -> float:
    """Return e^x for x <= 0, to 3e-14: no library's, so that all machines agree."""
    if x < _NEGLIGIBLE:
        return 0.0
    scale, rest = 1.0, x
    while rest < -0.5 * _LOG_2:
        scale, rest = 0.5 * scale, rest + _LOG_2
    tail = 1.0 + rest / 9.0 * (1.0 + rest / 10.0 * (1.0 + rest / 11.0 * (1.0 + rest / 12.0)))
    middle = 1.0 + rest / 5.0 * (1.0 + rest / 6.0 * (1.0 + rest / 7.0 * (1.0 + rest / 8.0 * tail)))
    head = 1.0 + rest / 2.0 * (1.0 + rest / 3.0 * (1.0 + rest / 4.0 * middle))
    return scale * (1.0 + rest * head)


def fit_report(p: FitParams, x: FitState) -> dict[str, Any]:
    """Return what is known of the vehicle, ready for JSON.

    ``fits``             whether it is in the box, as far as is known
    ``virtual_mass_kg``  that turns so on the settings' tyres, None while the speed shows nothing of
                         it; ``virtual_mass_std_kg`` is its standard deviation
    """
    share, deviation = x.share[0], sqrt(x.share[2])
    # The yaw rate, not K, is linear in the share.
    v2, per_kg = x.speed_m_s**2, understeer_gradient_s2_m(p.vehicle) / p.vehicle.virtual_mass_kg
    least, largest = (1.0 / (p.length_m + k * v2) for k in (p.least_s2_m, p.largest_s2_m))
    gain = least + share * (largest - least)
    if deviation > _DEVIATION_KNOWN_MAX or least - largest < WIDTH_MIN * least:
        return {"fits": x.fits, "virtual_mass_kg": None, "virtual_mass_std_kg": None}
    deviation_kg = deviation * (least - largest) / (gain * gain * v2 * abs(per_kg))
    mass_kg = (1.0 / gain - p.length_m) / (v2 * per_kg)
    return {"fits": x.fits, "virtual_mass_kg": mass_kg, "virtual_mass_std_kg": deviation_kg}
