"""Feedback loop of a plant's vehicle: the way from its hand wheel to the torque that comes back."""

from ...hand_wheel.nominal_road import Rack, RoadVehicle
from ...hand_wheel.nominal_road import road_torque as nominal_road_torque
from ...hand_wheel.wheel import LinearSystem
from ...plant_emulator.vehicle.single_track_model import VehicleParams

__all__ = ["Rack", "road_torque"]


def road_torque(vehicle: VehicleParams, torque_gradient_n_m: float, rack: Rack) -> LinearSystem:
    """Return the system from hand wheel angle [rad] to torque against it [N m]."""
    known = RoadVehicle(*(getattr(vehicle, name) for name in RoadVehicle._fields))
    return nominal_road_torque(known, torque_gradient_n_m, rack)
