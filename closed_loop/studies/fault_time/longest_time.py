"""The longest time that a fault may last so that the car stays in its lane.

The nodes run in virtual time. The fault begins at ``onset_s``, where a bend begins if there is one:
its curvature grows for ENTRY_S. After the time in question the steering reacts: the fault is
isolated, as by a second channel, and the fallback begins. The car stays if no corner of its body
leaves the lane until ``watch_s`` later. Whether a longer fault is worse is assumed, and the time
found by halving; nothing else in the plant reacts to the fault.
"""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from ....controller.settings import controller_preset
from ....plant_emulator.path.ellipse_and_lane_changes import path_of_curvature
from ....plant_emulator.path.path import Path
from ....plant_emulator.path.settings import PathModel, PluginPathSettings
from ....plant_emulator.settings import PlantSettings, plant_preset
from ....plant_emulator.steering.safety_limiter import acceleration_gain_m_s2
from ....plant_emulator.vehicle.settings import VehicleSettings
from ....runtime.settings import Settings, with_values
from ...pair.virtual_pair import make_virtual_pair, run_virtual_nodes
from .settings import Case, FallbackName, FaultName, FaultTimeSettings

ENTRY_S = 1.5
"""As on roads with clothoids, where the lateral jerk is at most 1.3 m/s³ for 2 m/s²; chosen."""
_BEND = "steer_by_wire.closed_loop.studies.fault_time.longest_time:BEND"
_COMMAND: Mapping[str, Any] = {"direction": "downlink", "message": "STEERING_COMMAND"}
_WHEEL: Mapping[str, Any] = {"direction": "steering"}


class Bend(Settings):
    """A straight road, and a bend to the left from ``start_m`` on until ``end_m``, by clothoids."""

    start_m: float
    end_m: float
    clothoid_m: float
    curvature_1_m: float


def _road(own: Bend) -> Path:
    bend_m = own.start_m + own.clothoid_m, own.end_m
    bend = [(at_m, own.curvature_1_m) for at_m in bend_m]
    return path_of_curvature([(own.start_m, 0.0), *bend, (own.end_m + own.clothoid_m, 0.0)])


_ANY = FallbackName.KEEP
BEND = PathModel(_road, settings=Bend)


def longest_time_s(settings: FaultTimeSettings, case: Case) -> float:
    """Return the time [s] of a case.

    Infinite if the car stays after ``time_s_max``, 0 if it leaves although the steering reacts at
    once, NaN if it leaves its lane without a fault.
    """
    if not _stays_healthy(settings, case._replace(fault=FaultName.SILENCE, fallback=_ANY)):
        return math.nan
    if _stays(settings, case, settings.time_s_max):
        return math.inf
    if not _stays(settings, case, 0.0):
        return 0.0
    low, high = 0, math.ceil(settings.time_s_max / settings.resolution_s)
    while high - low > 1:
        middle = (low + high) // 2
        if _stays(settings, case, middle * settings.resolution_s):
            low = middle
        else:
            high = middle
    return low * settings.resolution_s


@lru_cache(maxsize=64)
def _stays_healthy(settings: FaultTimeSettings, case: Case) -> bool:
    """Return whether the car stays in its lane without a fault."""
    return _stays(settings, case, None)


def _stays(settings: FaultTimeSettings, case: Case, time_s: float | None) -> bool:
    """Return whether the car stays in its lane if the fault lasts a time; None: without one."""
    pair = make_virtual_pair(
        plant_of(settings, case, time_s), controller_preset(settings.controller_preset)
    )

    def has_left() -> bool:
        report = pair.plant.report()
        return bool(report["failure"]) or (report["beyond_lane_m"] or -1.0) > 0.0

    run_virtual_nodes(pair.edge, pair.controller, None, None, has_left)
    return not has_left()


def plant_of(settings: FaultTimeSettings, case: Case, time_s: float | None) -> PlantSettings:
    """Return the plant of a run; raises SettingsError."""
    preset = plant_preset(settings.plant_preset, settings.plant)
    vehicle = preset.vehicle.model_copy(update={"speed_m_s": case.speed_km_h / 3.6})
    duration_s = settings.onset_s + (time_s or 0.0) + settings.watch_s
    bend = Bend(
        start_m=vehicle.speed_m_s * settings.onset_s,
        end_m=vehicle.speed_m_s * (duration_s + ENTRY_S),
        clothoid_m=vehicle.speed_m_s * ENTRY_S,
        curvature_1_m=case.curvature_1_m,
    )
    path = PluginPathSettings(model=_BEND, own=bend)
    values: dict[str, Any] = {
        "vehicle.speed_m_s": vehicle.speed_m_s,
        "duration_s": duration_s,
        "safety.ftti_ms": "off",
        "safety.follow_tolerance_rad": "off",
        "disturbance.steps": [
            {"at_s": 0.0, "side_force_n": settings.bank_m_s2 * vehicle.virtual_mass_kg}
        ],
    }
    if time_s is not None:
        stops = case.fallback is FallbackName.FOLLOW_AND_STOP
        values["safety.fallback"] = str(FallbackName.FOLLOW_PATH if stops else case.fallback)
        values |= {"safety.stop_m_s2": settings.stop_m_s2} if stops else {}
        values["safety.override_at_s"] = settings.onset_s + time_s
        if time_s > 0.0:
            lasting = {"onset_s": settings.onset_s, "duration_s": time_s}
            values["faults"] = [_fault(settings, case.fault, vehicle) | lasting]
    on_road = preset.model_copy(update={"path": path, "faults": ()})
    return with_values(on_road, values, "fault_time")


def _fault(
    settings: FaultTimeSettings, fault: FaultName, vehicle: VehicleSettings
) -> dict[str, Any]:
    if fault is FaultName.OFFSET:
        gain_m_s2 = acceleration_gain_m_s2(
            vehicle.speed_m_s,
            vehicle.virtual_mass_kg,
            vehicle.front_cornering_stiffness_n_rad,
            vehicle.rear_cornering_stiffness_n_rad,
            vehicle.front_axle_distance_m,
            vehicle.rear_axle_distance_m,
        )
        offset_rad = settings.offset_m_s2 / gain_m_s2
        return {"kind": "offset", "signal": "steer_rad", "magnitude": offset_rad, **_COMMAND}
    others: Mapping[FaultName, dict[str, Any]] = {
        FaultName.SILENCE: {"kind": "drop", **_COMMAND},
        FaultName.STUCK: {"kind": "stuck_wheel", **_WHEEL},
        FaultName.WRONG_SIGN: {
            "kind": "scale", "signal": "steer_rad", "magnitude": -1.0, **_COMMAND,
        },
        FaultName.HALF_TORQUE: {"kind": "weak_motor", "magnitude": 0.5, **_WHEEL},
        FaultName.LOST_CHANNEL: {"kind": "lost_channel", **_WHEEL},
    }  # fmt: skip
    return others[fault]
