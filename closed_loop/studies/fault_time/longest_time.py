"""The longest time that a fault may last so that the car stays in its lane.

The fault begins at ``onset_s``, where a bend begins if there is one: its curvature grows for
ENTRY_S. After the time in question the steering reacts: the fault is isolated, as by a second
channel, and the fallback begins. The car stays if no corner of its body leaves the lane until
``watch_s`` later, or until it nearly stands; for each shorter time, every ``scan_s``, it has to
stay as well. The runs are compiled: nothing but the steering reacts to the fault.
"""

import math
from functools import lru_cache
from typing import Any

from ....controller.settings import controller_preset
from ....plant_emulator.faults.settings import FaultKind
from ....plant_emulator.path.ellipse_and_lane_changes import path_of_curvature
from ....plant_emulator.path.path import Path
from ....plant_emulator.path.settings import PathModel, PluginPathSettings
from ....plant_emulator.settings import PlantSettings, plant_preset
from ....plant_emulator.vehicle.settings import VehicleSettings
from ....plant_emulator.vehicle.steady_turn import acceleration_gain_m_s2
from ....runtime.settings import Settings, with_values
from ...compiled.engine import Outcome, run_compiled
from .settings import Case, FallbackName, FaultName, FaultTimeSettings

ENTRY_S = 1.5
"""As on roads with clothoids, where the lateral jerk is at most 1.3 m/s³ for 2 m/s²; chosen."""
_BEND = "steer_by_wire.closed_loop.studies.fault_time.longest_time:BEND"
_SLOWEST_M_S = 1.5
"""Compiled runs end before the car stands."""


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


_plant, _controller = lru_cache(maxsize=4)(plant_preset), lru_cache(maxsize=4)(controller_preset)
_ANY = FallbackName.KEEP
BEND = PathModel(_road, settings=Bend)


def longest_time_s(settings: FaultTimeSettings, case: Case) -> float:
    """Return the time [s] of a case.

    Infinite if the car stays after ``time_s_max``, 0 if it leaves although the steering reacts at
    once, NaN if it leaves its lane without a fault.
    """
    if not _stays_healthy(settings, case._replace(fault=FaultName.SILENCE, fallback=_ANY)):
        return math.nan
    # A longer fault may be better: the law makes up for an offset, and then keeping is right.
    tried = range(math.floor(settings.time_s_max / settings.scan_s) + 1)
    leaving = next((n for n in tried if not _stays(settings, case, n * settings.scan_s)), None)
    if leaving is None:
        return math.inf
    if leaving == 0:
        return 0.0
    low, high = (leaving - 1) * settings.scan_s, leaving * settings.scan_s
    while high - low > 1.5 * settings.resolution_s:
        middle = low + settings.resolution_s * round(0.5 * (high - low) / settings.resolution_s)
        if _stays(settings, case, middle):
            low = middle
        else:
            high = middle
    return round(low, 6)


@lru_cache(maxsize=64)
def _stays_healthy(settings: FaultTimeSettings, case: Case) -> bool:
    """Return whether the car stays in its lane without a fault."""
    return _stays(settings, case, None)


def _stays(settings: FaultTimeSettings, case: Case, time_s: float | None) -> bool:
    """Return whether the car stays in its lane if the fault lasts a time; None: without one."""
    plant = plant_of(settings, case, time_s)
    run = run_compiled(plant, _controller(settings.controller_preset))
    is_in_lane = plant.car is None or bool((run.beyond_lane_m(plant.car.lane) <= 0.0).all())
    return run.outcome is Outcome.COMPLETE and is_in_lane


def plant_of(settings: FaultTimeSettings, case: Case, time_s: float | None) -> PlantSettings:
    """Return the plant of a run; raises SettingsError."""
    preset = _plant(settings.plant_preset, settings.plant)
    vehicle = preset.vehicle.model_copy(update={"speed_m_s": case.speed_km_h / 3.6})
    stops = case.fallback is FallbackName.FOLLOW_AND_STOP
    stop_s = (vehicle.speed_m_s - _SLOWEST_M_S) / settings.stop_m_s2 if stops else math.inf
    duration_s = settings.onset_s + (time_s or 0.0) + min(settings.watch_s, stop_s)
    longest_s = settings.onset_s + settings.time_s_max + settings.watch_s
    bend = Bend(
        start_m=vehicle.speed_m_s * settings.onset_s,
        end_m=vehicle.speed_m_s * (ENTRY_S + longest_s),
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
        values["safety.fallback"] = str(FallbackName.FOLLOW_PATH if stops else case.fallback)
        values |= {"safety.stop_m_s2": settings.stop_m_s2} if stops else {}
        values["safety.override_at_s"] = settings.onset_s + time_s
        if time_s > 0.0 and case.fault is FaultName.SILENCE:
            ends_s = (0.0, 0.0), (settings.onset_s, 1.0), (settings.onset_s + time_s, 0.0)
            schedule = [{"time_s": at_s, "mean_s": 0.0, "loss": loss} for at_s, loss in ends_s]
            values["latency.downlink.schedule"] = schedule
        elif time_s > 0.0:
            lasting = {"onset_s": settings.onset_s, "duration_s": time_s}
            values["faults"] = [_fault(settings, case.fault, vehicle) | lasting]
    drives_on = preset.safety.model_copy(update={"stop_m_s2": None})
    on_road = preset.model_copy(update={"path": path, "faults": (), "safety": drives_on})
    return with_values(on_road, values, "fault_time")


def _fault(
    settings: FaultTimeSettings, fault: FaultName, vehicle: VehicleSettings
) -> dict[str, Any]:
    offset_rad = settings.offset_m_s2 / acceleration_gain_m_s2(vehicle)
    kind, magnitude = {
        FaultName.STUCK: (FaultKind.STUCK_WHEEL, 1.0),
        FaultName.OFFSET: (FaultKind.OFFSET_SENSOR, offset_rad),
        FaultName.WRONG_SIGN: (FaultKind.REVERSED_WHEEL, 1.0),
        FaultName.HALF_TORQUE: (FaultKind.WEAK_MOTOR, 0.5),
        FaultName.LOST_CHANNEL: (FaultKind.LOST_CHANNEL, 1.0),
    }[fault]
    return {"kind": kind, "direction": "steering", "magnitude": magnitude}
