"""The steady turn of a linear vehicle: the steer that a curvature asks for, and what it gives.

δ = (L + K V²) ρ        K = m (l_r/C_f − l_f/C_r) / L      [rad per m/s²]
a_y = V²/(L + K V²) δ

L   wheelbase [m]       K   understeer gradient      V   speed [m/s]      ρ   curvature [1/m]
"""

from .settings import VehicleSettings
from .single_track_model import VehicleParams

Vehicle = VehicleSettings | VehicleParams


def wheelbase_m(vehicle: Vehicle) -> float:
    """Return the distance of the axles."""
    return vehicle.front_axle_distance_m + vehicle.rear_axle_distance_m


def understeer_gradient_s2_m(vehicle: Vehicle) -> float:
    """Return K [rad per m/s²]; negative: the vehicle oversteers."""
    compliance = (
        vehicle.rear_axle_distance_m / vehicle.front_cornering_stiffness_n_rad
        - vehicle.front_axle_distance_m / vehicle.rear_cornering_stiffness_n_rad
    )
    return vehicle.virtual_mass_kg / wheelbase_m(vehicle) * compliance


def steady_steer_m(vehicle: Vehicle) -> float:
    """Return the steer for each curvature [rad m]; not positive from the critical speed on."""
    return wheelbase_m(vehicle) + understeer_gradient_s2_m(vehicle) * vehicle.speed_m_s**2


def acceleration_gain_m_s2(vehicle: Vehicle) -> float:
    """Return the lateral acceleration for each steer [m/s² per rad].

    An oversteering vehicle (K < 0) has none from its critical speed on, where L + K V² = 0: then
    that of a neutral one, V²/L.
    """
    speed_m_s, length_m = vehicle.speed_m_s, wheelbase_m(vehicle)
    turning_m = length_m + understeer_gradient_s2_m(vehicle) * speed_m_s * speed_m_s
    return speed_m_s * speed_m_s / (turning_m if turning_m > 0.0 else length_m)
