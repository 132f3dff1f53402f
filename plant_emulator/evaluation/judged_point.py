"""The judged point of the vehicle: whose deviation from the path decides the verdict."""

from typing import Literal

from ..vehicle.settings import VehicleSettings

JudgedPoint = Literal["preview", "centre_of_gravity", "rear_axle"]
"""The car is where its centre of gravity is; the preview point lies ahead of it."""


def behind_preview_m(point: JudgedPoint, vehicle: VehicleSettings) -> float:
    """Return how far a point lies behind the preview point."""
    return {
        "preview": 0.0,
        "centre_of_gravity": vehicle.preview_distance_m,
        "rear_axle": vehicle.preview_distance_m + vehicle.rear_axle_distance_m,
    }[point]
