"""Feedback loop of a whole vehicle: hand wheel, bus, rack, tyres, and the torque that comes back.

The road wheel follows the hand wheel's angle over the steering ratio as a second-order servo of the
rack. The torque at the hand wheel is that of the front axle's slip angle,

    F = K i (δ - β - l_f r/V)

    K   torque_gradient_n_m  torque per angle of the hand wheel while the vehicle stands still
                             sideways [N m/rad]
    i   steering ratio       δ, β, r   as in ``plant_emulator.vehicle.single_track_model``
"""

from math import pi
from typing import NamedTuple

import numpy as np

from ...hand_wheel.wheel import LinearSystem
from ...plant_emulator.vehicle.single_track_model import VehicleParams, state_matrices


class Rack(NamedTuple):
    """Position servo of the rack and its ratio to the hand wheel; the defaults are chosen."""

    bandwidth_hz: float = 8.0
    damping: float = 0.8
    steering_ratio: float = 16.0


def road_torque(vehicle: VehicleParams, torque_gradient_n_m: float, rack: Rack) -> LinearSystem:
    """Return the system from hand wheel angle [rad] to torque [N m]; states δ, δ', β, r."""
    omega_rad_s = 2.0 * pi * rack.bandwidth_hz
    single_track = state_matrices(vehicle)
    a, b = np.zeros((4, 4)), np.zeros(4)
    a[0, 1] = 1.0
    a[1, :2] = -(omega_rad_s**2), -2.0 * rack.damping * omega_rad_s
    b[1] = omega_rad_s**2 / rack.steering_ratio
    a[2:, 2:] = single_track.a[:2, :2]
    a[2:, 0] = single_track.b[:2, 0]
    front_slip = np.array([1.0, 0.0, -1.0, -vehicle.front_axle_distance_m / vehicle.speed_m_s])
    return LinearSystem(a, b, torque_gradient_n_m * rack.steering_ratio * front_slip)
