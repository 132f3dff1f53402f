"""Whether the vehicle fits the box of [validity]: its yaw rate against that of the box's ends.

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

from math import exp, sqrt
from typing import Any

from ..filters.nominal_model import NominalVehicle
from ..limits.designed_ranges import ValiditySettings
from ..prediction.regression import regressed
from ..settings import ControllerSettings
from .plausibility import Motion, nominal_vehicle

DEVIATIONS = 3.0
MARGIN = 0.03
"""Of the width of the box: the yaw rate of a wheel that turns differs from a held one's."""
DEVIATION_MAX = 0.1
"""``tests.soak.ordinary_runs`` counts false alarms: 8 in 182 runs of the highway laws without this,
at deviations from 0.16."""
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
_WALKS_PER_S = (1e-4, 2.5e-5)
"""Variance that w and b [rad²/s²] gain in a second."""
_VARIANCES_MAX = (25.0, 0.01)
_NARROWEST_S2_M = 1e-4
"""A box of no width in K gets this one: 0.03 m of L + K V² at 60 km/h."""


def understeer_gradient_s2_m(vehicle: NominalVehicle) -> float:
    """Return K of the steady steer (L + K V²) ρ."""
    m, _, c_f, c_r, l_f, l_r, _, _ = vehicle
    return m / (l_f + l_r) * (l_r / c_f - l_f / c_r)


def gradients_s2_m(vehicle: NominalVehicle, box: ValiditySettings) -> tuple[float, float]:
    """Return the least and the largest K of a box around a nominal vehicle."""
    gradients = [understeer_gradient_s2_m(corner) for corner in box.corners(vehicle)]
    least, largest = min(gradients), max(gradients)
    if largest - least < _NARROWEST_S2_M:
        return least - 0.5 * _NARROWEST_S2_M, largest + 0.5 * _NARROWEST_S2_M
    return least, largest


def model_fit(settings: ControllerSettings) -> "ModelFit | None":
    """Return what judges the fit; None where the settings state no vehicle or no box."""
    vehicle, box = nominal_vehicle(settings), settings.validity
    return None if vehicle is None or box is None else ModelFit(vehicle, box)


class ModelFit:
    """Follows the vehicle's share of the box.

    ``vehicle``  the nominal one
    ``box``      what the settings were designed for

    ``fits``     whether it is in the box, as far as is known
    """

    def __init__(self, vehicle: NominalVehicle, box: ValiditySettings) -> None:
        self._least, self._largest = gradients_s2_m(vehicle, box)
        self._vehicle = vehicle
        self._nominal = understeer_gradient_s2_m(vehicle)
        self._length_m = vehicle.front_axle_distance_m + vehicle.rear_axle_distance_m
        self._late_rad = self._wheel_rad = self._yaw_rate_rad_s = 0.0
        self._x = (0.5, 0.0, _VARIANCES_MAX[0], 0.0, _VARIANCES_MAX[1])
        self._least_rad_s = self._left_rad2_s2 = 0.0
        self._steps = 0
        self._speed_m_s, self._yaw_lag_s = 0.0, 1.0
        self._lasted_s = 0.0
        self.fits = True

    def step(self, motion: Motion) -> None:
        """Take the means since the last step."""
        lasted_s, v, yaw_rate_rad_s = motion[:3]
        # The yaw rate follows a turning wheel late, by about this.
        if v != self._speed_m_s:
            self._speed_m_s, self._yaw_lag_s = v, self._lag_s(v)
        taken = 1.0 - exp(-lasted_s / self._yaw_lag_s)
        self._late_rad += taken * (motion.wheel_rad - self._late_rad)
        taken = 1.0 - exp(-lasted_s / _SMOOTHED_S)
        self._wheel_rad += taken * (self._late_rad - self._wheel_rad)
        self._yaw_rate_rad_s += taken * (yaw_rate_rad_s - self._yaw_rate_rad_s)
        r = self._yaw_rate_rad_s
        length_m, v2 = self._length_m, v * v
        least_rad_s = v * self._wheel_rad / (length_m + self._least * v2)
        largest_rad_s = v * self._wheel_rad / (length_m + self._largest * v2)
        turning_rad_s = least_rad_s - self._least_rad_s
        self._least_rad_s = least_rad_s
        timing_rad_s, transient_rad_s = _TIMING * turning_rad_s, _TRANSIENT * least_rad_s
        noise_rad2_s2 = max(self._left_rad2_s2, _NOISE_RAD2_S2_MIN)
        noise_rad2_s2 += timing_rad_s * timing_rad_s + transient_rad_s * transient_rad_s
        w, b, p_ww, p_wb, p_bb = self._x
        p_ww = min(p_ww + _WALKS_PER_S[0] * lasted_s, _VARIANCES_MAX[0])
        p_bb = min(p_bb + _WALKS_PER_S[1] * lasted_s, _VARIANCES_MAX[1])
        width_rad_s, over_rad_s = largest_rad_s - least_rad_s, r - least_rad_s
        coefficients = (w, b, p_ww, p_wb, p_bb)
        self._x = regressed(coefficients, width_rad_s, 1.0, over_rad_s, noise_rad2_s2)
        left_rad_s = over_rad_s - self._x[0] * width_rad_s - self._x[1]
        self._steps += 1
        weight = max(1.0 / self._steps, min(lasted_s / _NOISE_FORGETS_S, 1.0))
        self._left_rad2_s2 += weight * (left_rad_s * left_rad_s - self._left_rad2_s2)
        is_wide = abs(width_rad_s) >= WIDTH_MIN * abs(least_rad_s)
        if is_wide and self._x[2] <= DEVIATION_MAX * DEVIATION_MAX:
            self._judge(lasted_s)

    def report(self) -> dict[str, Any]:
        """Return what is known of the vehicle, ready for JSON.

        ``fits``             whether it is in the box, as far as is known
        ``virtual_mass_kg``  that turns so on the settings' tyres, None while the speed shows
                             nothing of it; ``virtual_mass_std_kg`` is its standard deviation
        """
        share, deviation = self._x[0], sqrt(self._x[2])
        # The yaw rate, not K, is linear in the share.
        v2, per_kg = self._speed_m_s**2, self._nominal / self._vehicle.virtual_mass_kg
        least, largest = (1.0 / (self._length_m + k * v2) for k in (self._least, self._largest))
        gain = least + share * (largest - least)
        if deviation > _DEVIATION_KNOWN_MAX or least - largest < WIDTH_MIN * least:
            return {"fits": self.fits, "virtual_mass_kg": None, "virtual_mass_std_kg": None}
        deviation_kg = deviation * (least - largest) / (gain * gain * v2 * abs(per_kg))
        mass_kg = (1.0 / gain - self._length_m) / (v2 * per_kg)
        return {"fits": self.fits, "virtual_mass_kg": mass_kg, "virtual_mass_std_kg": deviation_kg}

    def _lag_s(self, speed_m_s: float) -> float:
        """Return the lag of the yaw rate behind a turning wheel."""
        m, j, c_f, c_r, l_f, l_r, _, _ = self._vehicle
        v = max(speed_m_s, 0.1)
        a_11, a_12 = -(c_r + c_f) / (m * v), -1.0 + (c_r * l_r - c_f * l_f) / (m * v * v)
        a_21, a_22 = (c_r * l_r - c_f * l_f) / j, -(c_r * l_r**2 + c_f * l_f**2) / (j * v)
        b_1, b_2 = c_f / (m * v), c_f * l_f / j
        zero = b_2 / (a_21 * b_1 - a_11 * b_2)
        return max(-(a_11 + a_22) / (a_11 * a_22 - a_12 * a_21) - zero, 1e-3)

    def _judge(self, lasted_s: float) -> None:
        share, variance = self._x[0], self._x[2]
        over = max(share - 1.0, -share) - MARGIN
        is_outside = over > 0.0 and over * over > DEVIATIONS * DEVIATIONS * variance
        self._lasted_s = self._lasted_s + lasted_s if is_outside == self.fits else 0.0
        if self._lasted_s >= DEBOUNCE_S:
            self.fits, self._lasted_s = not self.fits, 0.0
