"""The judged point: which point of the vehicle is to be on the path, and where it lies."""

from typing import Literal

from ..vehicle.settings import VehicleSettings

FollowedPoint = Literal["preview", "centre_of_gravity", "rear_axle"]
"""The point of the vehicle that the controller holds on the path."""


def behind_preview_m(point: FollowedPoint, vehicle: VehicleSettings) -> float:
    """Return how far a point lies behind the preview point."""
    return {
        "preview": 0.0,
        "centre_of_gravity": vehicle.preview_distance_m,
        "rear_axle": vehicle.preview_distance_m + vehicle.rear_axle_distance_m,
    }[point]
