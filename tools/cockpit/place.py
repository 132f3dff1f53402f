"""Where the vehicle is in the world: the point of the path beside its preview point.

With the path known, the arc length decides: V times the time since the motion started. Of a foreign
bus the path is not known; it is then put together from the curvature in VEHICLE_STATE, which drifts
with the resolution of that signal, but is right in shape.
"""

from ...dbc.messages import VehicleState
from ...plant_emulator.path import Path, Pose, along_clothoid, pose
from ...runtime.node import NS_PER_S

_START = Pose(0.0, 0.0, 0.0)
_SILENT_S = 0.5
"""After so long without VEHICLE_STATE the vehicle is drawn where it was seen last."""


class Place:
    """Follows one vehicle."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._is_moving = False
        self._newest: tuple[int, VehicleState] | None = None
        self._pose = _START
        self._arc_length_m = 0.0

    def on_command(self, now_ns: int) -> None:
        """Take a command on the bus, the first of which starts the motion."""
        if not self._is_moving and self._newest is not None:
            self._is_moving = True
            self._newest = (now_ns, self._newest[1])

    def on_vehicle(self, message: VehicleState, now_ns: int) -> None:
        """Take the motion as measured."""
        self._pose = self.at(now_ns)
        if self._newest is not None:
            self._arc_length_m += self._way_m(now_ns, self._newest)
        self._newest = (now_ns, message)

    def at(self, now_ns: int) -> Pose:
        """Return the pose of the path beside the preview point."""
        if self._newest is None:
            return _START if self._path is None else pose(self._path, 0.0)
        way_m = min(self._way_m(now_ns, self._newest), _SILENT_S * self._newest[1].speed_m_s)
        if self._path is not None:
            return pose(self._path, self._arc_length_m + way_m)
        return along_clothoid(self._pose, self._newest[1].preview_curvature_1_m, 0.0, way_m)

    def _way_m(self, now_ns: int, newest: tuple[int, VehicleState]) -> float:
        """Return how far the vehicle has come since its newest message."""
        if not self._is_moving:
            return 0.0
        return newest[1].speed_m_s * max(now_ns - newest[0], 0) / NS_PER_S
