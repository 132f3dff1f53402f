"""Disturbances over time: side force, yaw moment, steering offset and friction, in steps.

    wβ = F/(m̃ V) + b11 δ_0              added to β' of (1)
    wr = (M + F l_F)/J + b21 δ_0        added to r' of (1)

    F    side force [N], l_F ahead of the centre of gravity [m]
    M    yaw moment [N m]
    δ_0  steering offset [rad]: on the front wheel, behind the actuator and unseen by its sensor
    b11, b21   as in (2), with the present friction

The force pushes the virtual mass m̃ = m/μ: on friction μ, a real force counts as F = real/μ. The
disturbance of the paper, the curvature of the path, comes from the path.
"""

from typing import NamedTuple

from ...runtime.node import NS_PER_S
from .settings import DisturbanceSettings
from .single_track_model import VehicleParams, on_friction, state_matrices


class DisturbanceInterval(NamedTuple):
    """Disturbance of the vehicle from ``start_ns`` until the next interval."""

    start_ns: int
    side_slip_disturbance_rad_s: float
    """wβ."""
    yaw_disturbance_rad_s2: float
    """wr."""
    friction: float
    steering_offset_rad: float
    """Already in wβ and wr."""


class Load(NamedTuple):
    """Disturbances of the vehicle: all that acts on it but the curvature of its path."""

    side_force_n: float = 0.0
    yaw_moment_n_m: float = 0.0
    steering_offset_rad: float = 0.0
    friction: float = 1.0


def disturbance_intervals(
    settings: DisturbanceSettings, vehicle: VehicleParams
) -> list[DisturbanceInterval]:
    """Return the profile; its first interval starts at 0, with the motion."""
    arm_m = settings.side_force_arm_m
    return [
        disturbance_interval(start_ns, load, arm_m, vehicle)
        for start_ns, load in loads(settings).items()
    ]


def loads(settings: DisturbanceSettings) -> dict[int, Load]:
    """Return the loads by the time of motion at which they begin [ns], the first at 0."""
    load, by_start_ns = Load(), {0: Load()}
    for step in settings.steps:
        load = load._replace(**step.model_dump(exclude={"at_s"}, exclude_none=True))
        by_start_ns[round(step.at_s * NS_PER_S)] = load
    return by_start_ns


def disturbance_interval(
    start_ns: int, load: Load, side_force_arm_m: float, vehicle: VehicleParams
) -> DisturbanceInterval:
    """Return the interval in which a load acts."""
    _, b = state_matrices(on_friction(vehicle, load.friction))
    yaw_moment = load.yaw_moment_n_m + load.side_force_n * side_force_arm_m
    return DisturbanceInterval(
        start_ns,
        load.side_force_n / (vehicle.virtual_mass_kg * vehicle.speed_m_s)
        + float(b[0, 0]) * load.steering_offset_rad,
        yaw_moment / vehicle.yaw_inertia_kg_m2 + float(b[1, 0]) * load.steering_offset_rad,
        load.friction,
        load.steering_offset_rad,
    )
