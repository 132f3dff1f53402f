"""Tyres of one axle: a lateral force that saturates, and slip that lags behind the motion.

    σ α̇′ = −|u| α′ − w          |α′| ≤ 3 D/C: beyond, the force has its limit
    Fiala           F = D z (1 − |z|/3 + z²/27),     z = C α′/D;   F = ± D from |z| = 3 on
    Magic Formula   F = D sin(c arctan(B α′ − E (B α′ − arctan B α′))),     B = C/(c D)
    D² = (μ F_z)² − F_x²          friction circle

    α′  lagged slip: the tangent of the slip angle in steady motion      [1]
    u   speed of the wheel along its plane                               [m/s]
    w   its speed across, to the left                                    [m/s]
    σ   relaxation length                                                [m]
    C   cornering stiffness, as large as the load F_z makes it           [N/rad]
    F   lateral force, to the left                                       [N]
    F_x longitudinal force                                               [N]

At standstill α′ is the deflection of a spring, C/σ, which a damper calms. Sources: Fiala, VDI-Z 96
(1954), in the form of Pacejka, Tire and Vehicle Dynamics (2012), section 3.2; relaxation, damping
and Magic Formula there in 7.2, 8.6 and 4.3. The arctangent is the project's own; the sine takes an
angle of c π/2 at most.
"""

from math import sqrt
from typing import NamedTuple

from ...path.portable_trigonometry import arctan, cos_sin

SLOW_M_S = 0.5
"""Below this speed a damper calms the spring; chosen."""
_SIDE_SHARE_MIN = 1e-3
"""The least share of μ F_z that a longitudinal force leaves; it keeps D from 0."""


class TyreParams(NamedTuple):
    """Tyres of one axle.

    ``stiffness_1_rad``   C/F_z
    ``damping_1_s_m``     damper at standstill, over F_z
    ``magic_shape``       c of the Magic Formula; 0 for Fiala
    ``magic_curvature``   E
    """

    stiffness_1_rad: float
    relaxation_1_m: float
    damping_s_m: float
    magic_shape: float
    magic_curvature: float


def side_limit_n(grip_n: float, longitudinal_n: float) -> float:
    """Return D for the friction μ F_z."""
    left_n2 = grip_n * grip_n - longitudinal_n * longitudinal_n
    least_n = _SIDE_SHARE_MIN * grip_n
    return sqrt(left_n2) if left_n2 > least_n * least_n else least_n


def lateral_n(p: TyreParams, load_n: float, limit_n: float, slip: float) -> float:
    """Return F for a lagged slip."""
    z = p.stiffness_1_rad * load_n * slip / limit_n
    if p.magic_shape > 0.0:
        steep = z / p.magic_shape
        angle_rad = arctan(steep - p.magic_curvature * (steep - arctan(steep)))
        _, sin = cos_sin(p.magic_shape * angle_rad)
        return limit_n * sin
    if z >= 3.0:
        return limit_n
    if z <= -3.0:
        return -limit_n
    return limit_n * z * (1.0 - abs(z) * (1.0 / 3.0) + z * z * (1.0 / 27.0))


def damped_n(
    p: TyreParams, load_n: float, limit_n: float, force_n: float, along: float, across: float
) -> float:
    """Return F with the damper that acts near standstill, for the wheel's speeds [m/s]."""
    if along >= SLOW_M_S:
        return force_n
    share = 1.0 - along / SLOW_M_S
    force_n -= share * p.damping_s_m * load_n * across
    return min(max(force_n, -limit_n), limit_n)


def slip_step(
    p: TyreParams,
    load_n: float,
    limit_n: float,
    slip: float,
    along_m_s: float,
    across_m_s: float,
    h_s: float,
) -> float:
    """Return α′ after ``h_s``; implicit in α′, so stable at any speed."""
    ratio = h_s * p.relaxation_1_m
    slip = (slip - ratio * across_m_s) / (1.0 + ratio * along_m_s)
    stiffness_n_rad, most_n = p.stiffness_1_rad * load_n, 3.0 * limit_n
    if -most_n <= stiffness_n_rad * slip <= most_n:
        return slip
    return (most_n if slip > 0.0 else -most_n) / stiffness_n_rad
