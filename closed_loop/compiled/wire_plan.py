"""Which messages of the plant the controller receives in a run, and when; computed beforehand."""

from functools import lru_cache
from typing import Any

import numpy as np

from ...controller.history.history import RING_SIZE, HistoryParams, Rings
from ...controller.history.plan import ROW_LENGTH
from ...controller.settings import ControllerSettings
from ...dbc.codec.protection import SequenceRule
from ...dbc.messages import (
    LateralError,
    PathAhead,
    SteeringPlan,
    SteeringStatus,
    VehicleState,
    limits,
    resolutions,
)
from ...plant_emulator.sensors.path_ahead import VALUES, curvatures_ahead_1_m, spacing_m
from ...plant_emulator.sensors.sampling import samples_per_vehicle_state
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.vehicle.motion_parameters import MotionParams
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.node import NS_PER_S
from .law_input import Uplink, Wire, on_wire
from .schedule import Plan, arrivals_of, sensor_noise

_KEPT = 8
"""Uplinks cached for the next run on the same network: half a megabyte each."""


def plan_wire(
    plant: PlantSettings, controller: ControllerSettings, plan: Plan, motion: MotionParams
) -> Wire:
    """Return the wire of one run."""
    samples = len(plan.sample_ns)
    network = plant_network(plant)
    received = _received(network, controller.counters, samples, plan.motion_start_ns)
    error, state = resolutions(LateralError), resolutions(VehicleState)
    ranges = limits(VehicleState)
    return Wire(
        HistoryParams(controller.loop_delay, controller.age_limits),
        empty_rings(keeps_plans=controller.law_record.plan is not None),
        *received,
        measured_heading_rad=np.empty(samples),
        measured_yaw_rate_rad_s=np.empty(samples),
        measured_curvature_1_m=np.empty(samples),
        wheel_rad=np.empty(samples),
        status=np.empty(samples, dtype=np.int64),
        speed_m_s=speed_on_wire(motion.speed_m_s),
        heading_resolution_rad=error["heading_error_rad"],
        yaw_rate_resolution_rad_s=state["yaw_rate_rad_s"],
        yaw_rate_rad_s_max=ranges["yaw_rate_rad_s"].maximum,
        curvature_resolution_1_m=state["preview_curvature_1_m"],
        curvature_1_m_max=ranges["preview_curvature_1_m"].maximum,
        wheel_resolution_rad=resolutions(SteeringStatus)["wheel_angle_rad"],
        wheel_rad_max=limits(SteeringStatus)["wheel_angle_rad"].maximum,
        steer_resolution_rad=resolutions(SteeringPlan)["steer_0_rad"],
        periods_per_sample=controller.link.sensor_period_s / (controller.period_ns / NS_PER_S),
        buffer=np.zeros(ROW_LENGTH),
        samples_per_path=samples_per_vehicle_state(plant.sensor_period_ns),
        path_spacing_m=_path_spacing_m(plant),
        path_ahead_1_m=_paths_ahead_1_m(plant, plan, motion),
        played_rad=np.full(samples if controller.law_record.plan is not None else 0, np.nan),
    )


def _path_spacing_m(plant: PlantSettings) -> float:
    """Return the spacing of PATH_AHEAD as the wire carries it, 0 where it is not sent [m]."""
    if plant.path_ahead is None:
        return 0.0
    wanted_m = spacing_m(plant.vehicle.speed_m_s, plant.path_ahead.reach_s)
    return float(on_wire(wanted_m, resolutions(PathAhead)["path_spacing_m"]))


def _paths_ahead_1_m(plant: PlantSettings, plan: Plan, motion: MotionParams) -> FloatArray:
    """Return the values of each PATH_AHEAD, as on the wire; shape (messages, values)."""
    if plant.path_ahead is None:
        return np.empty((0, VALUES))
    every = samples_per_vehicle_state(plant.sensor_period_ns)
    spacing = spacing_m(plant.vehicle.speed_m_s, plant.path_ahead.reach_s)
    rows = [
        curvatures_ahead_1_m(motion.path, motion.speed_m_s * (motion_ns / NS_PER_S), spacing)
        for motion_ns in plan.motion_ns[::every].tolist()
    ]
    resolution_1_m = resolutions(PathAhead)["curvature_0_1_m"]
    return np.asarray(np.rint(np.array(rows) / resolution_1_m) * resolution_1_m)


def speed_on_wire(speed_m_s: float) -> float:
    """Return the speed as VEHICLE_STATE carries it [m/s]."""
    highest_m_s = limits(VehicleState)["speed_m_s"].maximum
    return float(on_wire(min(speed_m_s, highest_m_s), resolutions(VehicleState)["speed_m_s"]))


def plant_network(plant: PlantSettings) -> PlantSettings:
    """Return the settings with everything at its default except the network."""
    return PlantSettings(
        seed=plant.seed,
        duration_s=plant.duration_s,
        sensor_period_ms=plant.sensor_period_ms,
        start_on_first_command=plant.start_on_first_command,
        sensor_noise=plant.sensor_noise,
        latency=plant.latency,
        path_ahead=plant.path_ahead,
    )


def empty_rings(*, keeps_plans: bool) -> Rings:
    """Return the initial rings of ``BusHistory``, as arrays."""
    arrays: dict[str, Any] = {name: np.zeros(RING_SIZE) for name in Rings._fields}
    arrays["plans"] = np.zeros((RING_SIZE if keeps_plans else 1, ROW_LENGTH))
    for name in ("has_error", "is_overruled"):
        arrays[name] = np.zeros(RING_SIZE, dtype=np.bool_)
    for name in ("applied_tick", "command_tick"):
        arrays[name] = np.full(RING_SIZE, -1)
    return Rings(**arrays)


@lru_cache(maxsize=_KEPT)
def _received(
    plant: PlantSettings, rule: SequenceRule, samples: int, motion_start_ns: int
) -> tuple[IntArray, IntArray, IntArray, FloatArray, FloatArray]:
    """Return the first arrays of ``Wire``, from ``arrival_ns`` on; runs share them."""
    each = [arrivals_of(message, plant, rule, samples, motion_start_ns) for message in Uplink]
    message = np.repeat(list(Uplink), [len(arrivals.sample) for arrivals in each])
    sample = np.concatenate([arrivals.sample for arrivals in each])
    arrival_ns = np.concatenate([arrivals.arrival_ns for arrivals in each])
    order = np.lexsort((message, sample, arrival_ns))
    heading_rad, yaw_rate_rad_s = sensor_noise(plant, samples, slice(1, 3))
    return arrival_ns[order], message[order], sample[order], heading_rad, yaw_rate_rad_s
