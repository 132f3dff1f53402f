"""The steady turn of a linear vehicle: the steer that a curvature asks for.

δ = (L + K V²) ρ        K = m (l_r/C_f − l_f/C_r) / L      [rad per m/s²]

L   wheelbase [m]       K   understeer gradient      V   speed [m/s]      ρ   curvature [1/m]
"""

from .settings import VehicleSettings


def wheelbase_m(vehicle: VehicleSettings) -> float:
    """Return the distance of the axles."""
    return vehicle.front_axle_distance_m + vehicle.rear_axle_distance_m


def understeer_gradient_s2_m(vehicle: VehicleSettings) -> float:
    """Return K [rad per m/s²]; negative: the vehicle oversteers."""
    compliance = (
        vehicle.rear_axle_distance_m / vehicle.front_cornering_stiffness_n_rad
        - vehicle.front_axle_distance_m / vehicle.rear_cornering_stiffness_n_rad
    )
    return vehicle.virtual_mass_kg / wheelbase_m(vehicle) * compliance


def steady_steer_m(vehicle: VehicleSettings) -> float:
    """Return the steer for each curvature [rad m]; not positive from the critical speed on."""
    return wheelbase_m(vehicle) + understeer_gradient_s2_m(vehicle) * vehicle.speed_m_s**2
