"""Settings that had no effect in a run, each in one line.

A test whose fault begins after the end of its run passes without having tested anything, and so
does one whose path the vehicle never reaches.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

from ..network.latency_distributions import Distribution
from ..network.settings import LatencySettings
from ..path.drivability import undrivable
from ..path.path import Path
from ..path.settings import PluginPathSettings, WaypointSettings
from ..settings import PlantSettings
from ..steering.safety_limiter import Cause
from ..steering.settings import design_guard
from ..vehicle.car.settings import CarSettings
from ..vehicle.steady_turn import steady_steer_m


def settings_without_effect(
    settings: PlantSettings,
    path: Path,
    traces_s: Mapping[str, Sequence[float]],
    motion_s: float,
    driven_m: float,
    clamped: int,
) -> list[str]:
    """Return what of the settings never acted, could not act in full, or no car could do.

    ``traces_s``  times of the rows of each direction's latency trace
    ``motion_s``  how long the vehicle has moved, and ``driven_m`` how far
    ``clamped``   values of the sensors that did not fit their signal
    """
    if not motion_s:
        return []
    end = f"the motion ended at {motion_s:g} s"
    late = [
        f"{what} from {at_s:g} s on: {end}"
        for what, at_s in _times(settings, traces_s)
        if at_s >= motion_s
    ]
    beyond = (
        f"{clamped} measured values were beyond the range of their signal, and clamped to it"
        " (a curvature of more than 0.2 1/m, for instance)"
    )
    path_lines = [*_path(settings, path, driven_m)]
    if settings.car is not None:
        path_lines += _car(settings.car, motion_s, driven_m)
    return [*late, *_spreads(settings), *path_lines, *([beyond] if clamped else [])]


def _times(
    settings: PlantSettings, traces_s: Mapping[str, Sequence[float]]
) -> Iterator[tuple[str, float]]:
    for number, fault in enumerate(settings.faults):
        yield f"faults[{number}] ({fault.kind}) never acted,", fault.onset_s
    for number, step in enumerate(settings.disturbance.steps):
        yield f"disturbance.steps[{number}] never acted,", step.at_s
    if settings.safety.override_at_s is not None:
        yield "safety.override_at_s never acted,", settings.safety.override_at_s
    for way in ("downlink", "uplink"):
        latency: LatencySettings = getattr(settings.latency, way)
        for number, point in enumerate(latency.schedule[1:], start=1):
            yield f"latency.{way}.schedule[{number}] never acted,", point.time_s
        for second_s in traces_s[way][1:2]:
            yield f"latency.{way}: only the first row of the trace acted, others", second_s


def _spreads(settings: PlantSettings) -> Iterator[str]:
    for way in ("downlink", "uplink"):
        latency: LatencySettings = getattr(settings.latency, way)
        if never_varies(latency):
            lacks = " and ".join(key for key in ("mean_s", "spread_s") if not getattr(latency, key))
            yield f"latency.{way} never varied: model {latency.model} needs {lacks} too"


def never_varies(latency: LatencySettings) -> bool:
    """Return whether the latency has a model that varies, and yet is always the same."""
    if latency.has_trace or latency.schedule or latency.model is Distribution.CONSTANT:
        return False
    low_s, high_s = (latency.quantile(u, latency.mean_s, latency.spread_s) for u in (0.01, 0.99))
    return low_s == high_s


def undrivable_by(settings: PlantSettings, path: Path) -> str:
    """Return the warning of ``undrivable`` for the vehicle of the settings."""
    car = settings.car
    if car is None:
        return undrivable(path, settings.vehicle.speed_m_s)
    grips = [1.0, *(patch.friction for patch in car.grip)]
    # A profile may be slow where the path bends.
    speed_m_s = min((v for _, v in car.profile), default=settings.vehicle.speed_m_s)
    return undrivable(path, speed_m_s, max(grips) * car.friction, is_car=True)


def _car(car: CarSettings, motion_s: float, driven_m: float) -> Iterator[str]:
    for number, patch in enumerate(car.grip):
        if patch.from_m >= driven_m:
            yield f"car.grip[{number}] never acted: the car drove {driven_m:.4g} m"
    reached = driven_m if car.is_over_arc_length else motion_s
    for number, (at, _) in enumerate(car.profile[1:], start=1):
        if at > reached:
            yield f"car.speed[{number}] was never reached: the run ended at {reached:.4g}"


def _path(settings: PlantSettings, path: Path, driven_m: float) -> Iterator[str]:
    speed_m_s = settings.vehicle.speed_m_s
    if not path.closed and driven_m < 0.999 * path.length_m:
        yield f"path: only {driven_m:.4g} m of its {path.length_m:.4g} m were driven"
    elif not path.closed and isinstance(settings.path, WaypointSettings | PluginPathSettings):
        end_s = path.length_m / speed_m_s
        yield f"path ends after {path.length_m:.4g} m ({end_s:.4g} s); from there on it is straight"
    if line := undrivable_by(settings, path):
        yield line
    if settings.vehicle.model is not None:
        return
    curvature_1_m = max(map(abs, path.curvature_1_m))
    needed_rad = curvature_1_m * steady_steer_m(settings.vehicle)
    guard = design_guard(settings.safety, settings.vehicle, settings.actuator)
    rows = guard.limiter.table.rows
    allowed_rad, cause = min(
        ((row.reach_rad, row.cause) for row in rows), default=(math.inf, Cause.ANGLE)
    )
    if needed_rad > allowed_rad:
        yield (
            f"path asks for {needed_rad:.3g} rad of steer where it bends most, and the limit"
            f" {Cause(cause).name.lower()} allows {allowed_rad:.3g} rad"
        )
