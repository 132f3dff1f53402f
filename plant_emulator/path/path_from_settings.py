"""The path that settings describe."""

from .corridor import through_corridor
from .ellipse_and_lane_changes import (
    circle,
    double_lane_change,
    ellipse,
    single_lane_change,
    straight,
)
from .path import Path
from .settings import (
    CircleSettings,
    CorridorSettings,
    DoubleLaneChangeSettings,
    EllipseSettings,
    PathSettings,
    PluginPathSettings,
    SingleLaneChangeSettings,
    StraightSettings,
    WaypointSettings,
    plugin_path,
)


def build_path(settings: PathSettings) -> Path:
    """Return the path of the settings.

    Raises SettingsError for an unreadable waypoint file, or points that give no path.
    """
    match settings:
        case StraightSettings():
            return straight()
        case CircleSettings():
            return circle(settings.radius_m)
        case EllipseSettings():
            return ellipse(settings.semi_major_axis_m, settings.semi_minor_axis_m)
        case SingleLaneChangeSettings():
            return single_lane_change(settings.start_m, settings.offset_m, settings.length_m)
        case DoubleLaneChangeSettings():
            return double_lane_change(settings.start_m, settings.offset_m, settings.length_m)
        case CorridorSettings():
            return through_corridor(settings)
        case WaypointSettings():
            # Only this kind needs scipy, whose import takes longer than the rest of the start.
            from .waypoints import waypoint_path

            return waypoint_path(
                settings.file, closed=settings.closed, spacing_min_m=settings.spacing_min_m
            )
        case PluginPathSettings():
            return plugin_path(settings.model, settings.own)
