"""Nominal road: the way from hand wheel angle to the torque that comes back, without a bus.

The road wheels follow the hand wheel by a servo. The torque at the hand wheel is that of the front
axle's slip angle,

    F  = K α_f                      σ_f α_f' = V (δ - β - l_f r/V - α_f)
    β' = (c_f α_f + c_r α_r)/(m V) - r        σ_r α_r' = V (-β + l_r r/V - α_r)
    r' = (c_f l_f α_f - c_r l_r α_r)/J

    K   torque_gradient_n_m  torque per angle of the hand wheel while the vehicle stands still
                             sideways [N m/rad]
    δ   angle of the road wheels [rad]. Here δ, β, r and α are those of the car times the steering
        ratio, which cancels
    β, r   side slip angle [rad] and yaw rate [rad/s] at the speed V
    α, σ   slip angle that the tyres' force has [rad], and their relaxation lengths [m]; without a
           length the force follows at once

The vehicle is the linear single track, derived here once more: the plant's own is not shared with
what is tested on it.
"""

from math import pi
from typing import NamedTuple

import numpy as np

from ...runtime.settings import Settings
from ..wheel import LinearSystem

_LAG_S_MIN = 1e-6
"""In place of a lag of 0, at which the servo has no state."""


class Rack(NamedTuple):
    """Servo of the road wheels; the defaults are chosen.

    ``lag_s``  of a servo of first order in place of the second, as the linear plant has
    """

    bandwidth_hz: float = 8.0
    damping: float = 0.8
    lag_s: float | None = None


class RoadVehicle(NamedTuple):
    """The symbols above, for one vehicle at one speed; both relaxation lengths, or neither."""

    speed_m_s: float
    virtual_mass_kg: float
    yaw_inertia_kg_m2: float
    front_cornering_stiffness_n_rad: float
    rear_cornering_stiffness_n_rad: float
    front_axle_distance_m: float
    rear_axle_distance_m: float
    front_relaxation_m: float = 0.0
    rear_relaxation_m: float = 0.0


OF_VEHICLE = tuple(it for it in RoadVehicle._fields if it not in RoadVehicle._field_defaults)


def road_vehicle(table: Settings, tyres: Settings | None = None) -> RoadVehicle:
    """Return the vehicle of settings with its names; ``tyres``: None if they follow at once."""
    vehicle = RoadVehicle(*(getattr(table, name) for name in OF_VEHICLE))
    if tyres is None:
        return vehicle
    return vehicle._replace(**{name: getattr(tyres, name) for name in RoadVehicle._field_defaults})


def road_torque(vehicle: RoadVehicle, torque_gradient_n_m: float, rack: Rack) -> LinearSystem:
    """Return the system from hand wheel angle [rad] to torque against it [N m].

    Its states are δ, for a servo of second order δ', β and r, and α_f and α_r with relaxation.
    """
    v, m, j, c_f, c_r, l_f, l_r, *relaxation_m = vehicle
    by_front = np.array([c_f / (m * v), c_f * l_f / j])
    slip = np.array([-1.0, -l_f / v])
    servo = _servo(rack)
    order = len(servo.b)
    if all(relaxation_m):
        to_slip_1_s = v / np.array(relaxation_m)
        motion = np.zeros((4, 4))
        motion[0, 1] = -1.0
        motion[:2, 2], motion[:2, 3] = by_front, (c_r / (m * v), -c_r * l_r / j)
        motion[2:, :2] = to_slip_1_s[:, np.newaxis] * (slip, (-1.0, l_r / v))
        motion[2, 2], motion[3, 3] = -to_slip_1_s
        by_wheel = np.array([0.0, 0.0, to_slip_1_s[0], 0.0])
        torque = np.array([*np.zeros(order + 2), 1.0, 0.0])
    else:
        motion = np.array(
            [
                [-(c_r + c_f) / (m * v), (c_r * l_r - c_f * l_f) / (m * v * v) - 1.0],
                [(c_r * l_r - c_f * l_f) / j, -(c_r * l_r * l_r + c_f * l_f * l_f) / (j * v)],
            ]
        )
        by_wheel, torque = by_front, np.array([*servo.c, *slip])
    a, b = np.zeros((len(torque), len(torque))), np.zeros(len(torque))
    a[:order, :order], b[:order] = servo.a, servo.b
    a[order:, order:], a[order:, :order] = motion, np.outer(by_wheel, servo.c)
    return LinearSystem(a, b, torque_gradient_n_m * torque)


def _servo(rack: Rack) -> LinearSystem:
    if rack.lag_s is not None:
        rate_1_s = 1.0 / max(rack.lag_s, _LAG_S_MIN)
        return LinearSystem(np.array([[-rate_1_s]]), np.array([rate_1_s]), np.array([1.0]))
    omega_rad_s = 2.0 * pi * rack.bandwidth_hz
    a = [[0.0, 1.0], [-(omega_rad_s**2), -2.0 * rack.damping * omega_rad_s]]
    return LinearSystem(np.array(a), np.array([0.0, omega_rad_s**2]), np.array([1.0, 0.0]))
