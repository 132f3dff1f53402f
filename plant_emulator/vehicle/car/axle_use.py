"""Axles of a car in use: their load, and how much of their friction is used.

    use = √(F_x² + F_y²)/(μ F_z)        1: the tyres of this axle can give no more

The forces are those of ``car_step`` at the present state, without the damper near standstill.
"""

from math import hypot
from typing import NamedTuple

from .car_step import CarParams, CarState, along_n, axle_loads_n
from .tyre import lateral_n, side_limit_n


class AxleUse(NamedTuple):
    """Use of the friction in front and at the rear, the front's share of the load, v̇ + u r."""

    front_grip_used: float
    rear_grip_used: float
    front_load_share: float
    lateral_acceleration_m_s2: float


def axle_use(p: CarParams, x: CarState, demand_m_s2: float, friction: float) -> AxleUse:
    """Return it for the acceleration that the speed control asks for.

    ``friction`` is a factor on that of the tyres.
    """
    front_load_n, rear_load_n = axle_loads_n(p, x.longitudinal_m_s2)
    grip = p.friction * friction
    front_grip_n, rear_grip_n = grip * front_load_n, grip * rear_load_n
    front_x_n = rear_x_n = 0.0
    if x.speed_m_s > 0.0:  # nothing pushes a car that its brakes hold
        drag_n = p.drag_n_s2_m2 * x.speed_m_s * x.speed_m_s
        wanted_n = p.mass_kg * (demand_m_s2 + p.rolling_m_s2) + drag_n
        front_x_n, rear_x_n = along_n(p, wanted_n, front_grip_n, rear_grip_n)
    front_limit_n = side_limit_n(front_grip_n, front_x_n)
    rear_limit_n = side_limit_n(rear_grip_n, rear_x_n)
    front_y_n = lateral_n(p.front, front_load_n, front_limit_n, x.front_slip)
    rear_y_n = lateral_n(p.rear, rear_load_n, rear_limit_n, x.rear_slip)
    return AxleUse(
        hypot(front_x_n, front_y_n) / front_grip_n,
        hypot(rear_x_n, rear_y_n) / rear_grip_n,
        front_load_n / (front_load_n + rear_load_n),
        x.lateral_m_s2,
    )
