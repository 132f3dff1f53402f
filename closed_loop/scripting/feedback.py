"""Feedback loop of a plant's vehicle: the way from its hand wheel to the torque that comes back."""

import numpy as np

from ...hand_wheel.analysis.nominal_road import Rack, RoadVehicle
from ...hand_wheel.analysis.nominal_road import road_torque as nominal_road_torque
from ...hand_wheel.analysis.sampled_laws import PASS_THROUGH, sampled_cdob
from ...hand_wheel.analysis.sampled_loop import (
    SampledFeedback,
    sampled_feedback,
    unstable_round_trips,
)
from ...hand_wheel.settings import HandWheelSettings
from ...hand_wheel.wheel import GRIPS, LinearSystem, held_wheel
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.vehicle.car.settings import CarSettings
from ...plant_emulator.vehicle.motion_parameters import vehicle_params
from ...plant_emulator.vehicle.single_track_model import VehicleParams

__all__ = ["Rack", "road_torque"]
UP_TO_S = 2.0
"""The longest round trip that is looked at."""


def road_torque(
    vehicle: VehicleParams, torque_gradient_n_m: float, rack: Rack, car: CarSettings | None = None
) -> LinearSystem:
    """Return the system from hand wheel angle [rad] to torque against it [N m].

    ``car``  whose tyres need a way to build up their force
    """
    known = RoadVehicle(*(getattr(vehicle, name) for name in RoadVehicle._fields))
    relaxation_m = (0.0, 0.0) if car is None else (car.front_relaxation_m, car.rear_relaxation_m)
    return nominal_road_torque(known, torque_gradient_n_m, rack, relaxation_m)


def spring_torque(road: LinearSystem, gradient_n_m: float, rack: Rack) -> LinearSystem:
    """Return a road whose torque is that of a spring, which the road wheels stretch."""
    of_wheel = np.zeros(len(road.c))
    of_wheel[0] = gradient_n_m * rack.steering_ratio
    return road._replace(c=of_wheel)


def feedback_loop(plant: PlantSettings, wheel: HandWheelSettings) -> SampledFeedback | None:
    """Return the loop of a pair's hand wheel, linear and without friction; None for no bus in it.

    A car is taken as its [vehicle], with the lag of its [actuator] and the relaxation of its tyres.
    """
    linear, law = wheel.wheel.linear, wheel.feedback
    if law.law == "model":
        return None
    rack = Rack(steering_ratio=wheel.steering_ratio, lag_s=max(plant.actuator.lag_s, 1e-6))
    vehicle = vehicle_params(plant.vehicle)
    road = road_torque(vehicle, law.torque_gradient_n_m, rack, plant.car)
    if law.law == "spring":
        road = spring_torque(road, law.torque_gradient_n_m, rack)
    damped = linear._replace(damping_n_m_s=linear.damping_n_m_s + law.damping_n_m_s)
    held = held_wheel(damped, GRIPS[wheel.driver.grip])
    sampled = PASS_THROUGH
    if law.law == "cdob":
        sampled = sampled_cdob(
            wheel.nominal_way, wheel.cycle_s, law.cutoff_rad_s, law.washout_rad_s
        )
    return sampled_feedback(held, road, wheel.cycle_s, sampled)


def computed_text(plant: PlantSettings, wheel: HandWheelSettings) -> str:
    """Return from which round trip on the hand wheel of a pair shakes, in words."""
    loop = feedback_loop(plant, wheel)
    if loop is None:
        return "computed: the law needs no bus"
    ranges = unstable_round_trips(loop, UP_TO_S)
    if not ranges:
        return f"computed: stable at any round trip up to {UP_TO_S:g} s"
    return (
        f"computed: unstable from a round trip of {1e3 * ranges[0].start_s:.0f} ms on, without"
        " friction"
    )
