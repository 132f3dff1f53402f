"""Text of ``steer-by-wire plant --check``: the settings in effect, and what follows from them.

The text is a valid settings file: everything but the settings is a TOML comment.
"""

import math
from collections.abc import Iterator

import numpy as np

from ...runtime.settings.toml_text import dump_toml
from ..path.path import curvature
from ..settings import PlantSettings, plant_motion_params
from ..steering.safety_limiter import AVERAGING_S, Cause
from ..steering.settings import design_guard
from ..vehicle.car.settings import CarSettings
from ..vehicle.car.steady_state import steady_turn
from ..vehicle.moving_vehicle import AnyMotionParams
from ..vehicle.steady_turn import steady_steer_m, understeer_gradient_s2_m, wheelbase_m

_POINTS = 4000
"""Points of the path at which the demand is computed."""


def check_text(settings: PlantSettings) -> str:
    """Return the settings and what follows from them; raises as they do."""
    params = plant_motion_params(settings)
    comments = [*_vehicle(settings), "", *_path(settings, params)]
    lines = [f"# {comment}" if comment else "#" for comment in comments]
    return "\n".join([dump_toml(settings), *lines, ""])


def _vehicle(settings: PlantSettings) -> Iterator[str]:
    vehicle = settings.vehicle
    model = vehicle.model if settings.car is None else settings.car.model
    if model is not None:
        yield f"Vehicle: equations of another package ({model}), which are not analysed."
        return
    length_m = wheelbase_m(vehicle)
    gradient = understeer_gradient_s2_m(vehicle)
    yield f"Vehicle: {vehicle.speed_m_s:.4g} m/s ({3.6 * vehicle.speed_m_s:.4g} km/h):"
    yield f"  wheelbase            {length_m:.4g} m"
    yield f"  understeer gradient  {gradient:.4g} rad per m/s²"
    if gradient < 0.0:
        critical_m_s = math.sqrt(-length_m / gradient)
        verdict = "above it: UNSTABLE" if critical_m_s <= vehicle.speed_m_s else "below it: stable"
        yield f"  critical speed       {critical_m_s:.4g} m/s, {verdict}"
    else:
        yield "  critical speed       none: it does not oversteer"


def _path(settings: PlantSettings, params: AnyMotionParams) -> Iterator[str]:
    vehicle, path = settings.vehicle, params.path
    speed_m_s = vehicle.speed_m_s
    driven_m = speed_m_s * settings.duration_s
    lap = f"a lap of {path.length_m:.4g} m" if path.closed else f"{path.length_m:.4g} m long"
    yield f"Path: {settings.path.kind}, {lap}; {driven_m:.4g} m in {settings.duration_s:g} s:"
    within_m = min(driven_m, path.length_m or driven_m) or driven_m
    places_m = np.linspace(0.0, within_m, _POINTS).tolist()
    curvature_1_m = np.array([curvature(path, place_m) for place_m in places_m])
    largest_1_m = float(np.abs(curvature_1_m).max())
    yield f"  largest curvature    {largest_1_m:.4g} 1/m"
    yield f"  lateral acceleration {speed_m_s**2 * largest_1_m:.4g} m/s²"
    if settings.car is not None:
        yield _grip(settings, settings.car, largest_1_m)
    # From the critical speed on it is not positive.
    steer_m = steady_steer_m(vehicle)
    if vehicle.model is not None or steer_m <= 0.0:
        return
    steer = steer_m * curvature_1_m
    window = max(1, min(_POINTS - 1, round(AVERAGING_S * speed_m_s / within_m * _POINTS)))
    windows = np.lib.stride_tricks.sliding_window_view(steer, window + 1)
    sweep_rad = float(np.ptp(windows, axis=1).max())
    reach_rad = float(np.abs(steer).max())
    within = f" within {AVERAGING_S:g} s"
    yield f"  steer to follow it   {reach_rad:.4g} rad, {sweep_rad:.4g} rad{within}"
    guard = design_guard(settings.safety, vehicle, settings.actuator)
    for row in guard.limiter.table.rows:
        for needed_rad, allowed_rad, when in (
            (reach_rad, row.reach_rad, ""),
            (sweep_rad, row.sweep_rad, within),
        ):
            if math.isfinite(allowed_rad):
                name = Cause(row.cause).name.lower()
                verdict = "" if needed_rad <= allowed_rad else "  TOO LITTLE for this path"
                yield f"  limit {name:21} {allowed_rad:.4g} rad{when}{verdict}"
    stop_rad = settings.actuator.angle_limit_rad
    if stop_rad is not None and stop_rad < reach_rad:
        yield f"  actuator angle limit {stop_rad:.4g} rad  TOO LITTLE for this path"


def _grip(settings: PlantSettings, car: CarSettings, curvature_1_m: float) -> str:
    """Return how much of its grip a car needs for the sharpest bend, and what it is there."""
    speed_m_s = settings.vehicle.speed_m_s
    try:
        turn = steady_turn(settings.vehicle, car, speed_m_s, curvature_1_m)
    except ValueError as error:
        return f"  grip                 {error}"
    return (
        f"  grip used there      {100.0 * turn.grip_share:.0f} %, cornering stiffness"
        f" {turn.vehicle.front_cornering_stiffness_n_rad:.4g} and"
        f" {turn.vehicle.rear_cornering_stiffness_n_rad:.4g} N/rad"
    )
