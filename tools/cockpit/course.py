"""What a page draws beside the signals: the vehicle to scale and the path it is to follow."""

from collections.abc import Sequence
from typing import NamedTuple

from ...plant_emulator.path import Path, pose
from ...plant_emulator.path_shapes import build_path
from ...plant_emulator.rig_settings import VehicleSettings
from .scenario import LaneSettings

_POINT_M = 0.5
_OPEN_END_M = 400.0
"""How much of an open path is drawn."""
_POINTS_MAX = 4000


class LaneFacts(NamedTuple):
    """One lane, ready for JSON.

    ``path_m``  points (x, y) of the path, empty where it is not known
    """

    label: str
    front_axle_m: float
    rear_axle_m: float
    preview_m: float
    path_m: Sequence[tuple[float, float]]
    path_is_closed: bool


def lane_facts(lane: LaneSettings) -> LaneFacts:
    """Return the facts of a lane of our own."""
    path = build_path(lane.plant.path)
    return _facts(lane.label, lane.plant.vehicle, _points(path), path.closed)


def foreign_facts(label: str) -> LaneFacts:
    """Return those of a bus that somebody else drives: the vehicle of the wire contract."""
    return _facts(label, VehicleSettings(), (), False)


def _facts(
    label: str, vehicle: VehicleSettings, points: Sequence[tuple[float, float]], is_closed: bool
) -> LaneFacts:
    return LaneFacts(
        label,
        vehicle.front_axle_distance_m,
        vehicle.rear_axle_distance_m,
        vehicle.preview_distance_m,
        points,
        is_closed,
    )


def _points(path: Path) -> Sequence[tuple[float, float]]:
    length_m = path.length_m if path.closed else path.length_m + _OPEN_END_M
    count = min(round(length_m / _POINT_M), _POINTS_MAX)
    places = (pose(path, length_m * number / count) for number in range(count + 1))
    return [(round(place.x_m, 3), round(place.y_m, 3)) for place in places]
