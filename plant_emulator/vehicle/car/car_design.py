"""Constants of a car's motion, from the settings tables."""

import math
from collections.abc import Sequence

from ...path.drivability import GRAVITY_M_S2
from ...path.path import Path
from ..disturbance import Load, loads
from ..settings import ActuatorSettings, DisturbanceSettings, VehicleSettings
from .car_choice import own_car_params
from .car_motion import CarInterval, CarMotionParams, GripPatch
from .car_step import CarParams
from .first_order import FirstOrderParams
from .rack_settings import rack_params
from .settings import CarSettings
from .speed_control import SpeedParams, speed_legs
from .steering_input import Failure, health_at
from .tyre import TyreParams

_DAMPING_RATIO = 0.3
"""Of an axle's mass on the spring of its tyres, at standstill; chosen."""


def car_params(
    vehicle: VehicleSettings, car: CarSettings, gravity_m_s2: float = GRAVITY_M_S2
) -> CarParams:
    """Return the constants of the equations."""
    front_m, rear_m = vehicle.front_axle_distance_m, vehicle.rear_axle_distance_m
    mass, wheelbase_m = vehicle.virtual_mass_kg, front_m + rear_m
    front_load_n = mass * gravity_m_s2 * rear_m / wheelbase_m
    rear_load_n = mass * gravity_m_s2 * front_m / wheelbase_m
    shape = car.magic_shape if car.tyre == "magic_formula" else 0.0

    def tyre(stiffness_n_rad: float, load_n: float, relaxation_m: float) -> TyreParams:
        damping_n_s_m = (
            2.0 * _DAMPING_RATIO * math.sqrt(stiffness_n_rad / relaxation_m * load_n / gravity_m_s2)
        )
        return TyreParams(
            stiffness_n_rad / load_n,
            1.0 / relaxation_m,
            damping_n_s_m / load_n,
            shape,
            car.magic_curvature,
        )

    return CarParams(
        mass_kg=mass,
        mass_1_kg=1.0 / mass,
        yaw_inertia_1_kg_m2=1.0 / vehicle.yaw_inertia_kg_m2,
        front_axle_m=front_m,
        rear_axle_m=rear_m,
        preview_m=vehicle.preview_distance_m,
        front_load_n=front_load_n,
        rear_load_n=rear_load_n,
        load_shift_kg=mass * car.cg_height_m / wheelbase_m,
        friction=car.friction,
        front=tyre(vehicle.front_cornering_stiffness_n_rad, front_load_n, car.front_relaxation_m),
        rear=tyre(vehicle.rear_cornering_stiffness_n_rad, rear_load_n, car.rear_relaxation_m),
        drive_front=car.drive_front,
        brake_front=car.brake_front,
        drag_n_s2_m2=car.drag_n_s2_m2,
        rolling_m_s2=car.rolling_resistance * gravity_m_s2,
    )


def car_motion_params(
    vehicle: VehicleSettings,
    car: CarSettings,
    actuator: ActuatorSettings,
    path: Path,
    disturbance: DisturbanceSettings,
    failures: Sequence[Failure] = (),
) -> CarMotionParams:
    """Return the constants of a motion on a path that is built."""
    points = car.profile or [(0.0, vehicle.speed_m_s)]
    mass = vehicle.virtual_mass_kg
    starts = [0.0, *(patch.from_m for patch in car.grip), math.inf]
    frictions = [1.0, *(patch.friction for patch in car.grip)]
    built_in = car_params(vehicle, car)
    return CarMotionParams(
        car=built_in if car.model is None else own_car_params(car.model, built_in, car.own),
        steering=FirstOrderParams(
            actuator.lag_s,
            _or_infinite(actuator.angle_limit_rad),
            _or_infinite(actuator.rate_limit_rad_s),
            actuator.dead_band_rad,
        )
        if car.rack is None
        else rack_params(car.rack, actuator, vehicle),
        speed=SpeedParams(
            speed_legs(points, over_arc_length=car.is_over_arc_length),
            car.is_over_arc_length,
            car.speed_gain_1_s,
            car.drive_force_n_max / mass,
            car.brake_force_n_max / mass,
            car.jerk_m_s3_max,
        ),
        path=path,
        patches=[
            GripPatch(end_m, friction)
            for end_m, friction in zip(starts[1:], frictions, strict=True)
        ],
        intervals=_intervals(disturbance, failures),
        speed_m_s=points[0][1],
        preview_distance_m=vehicle.preview_distance_m,
        lateral_error_m=vehicle.initial_lateral_error_m,
        heading_error_rad=vehicle.initial_heading_error_rad,
        dead_time_ns=actuator.dead_time_ns,
    )


def _intervals(disturbance: DisturbanceSettings, failures: Sequence[Failure]) -> list[CarInterval]:
    by_start_ns = loads(disturbance)
    changes_ns = {time_ns for one in failures for time_ns in (one.start_ns, one.end_ns)}
    intervals, load = [], by_start_ns[0]
    for start_ns in sorted(by_start_ns.keys() | changes_ns):
        load = by_start_ns.get(start_ns, load)
        healthy = CarInterval(start_ns, 0.0, 0.0, 0.0, 1.0, *health_at(failures, start_ns))
        intervals.append(under_load(healthy, load, disturbance.side_force_arm_m))
    return intervals


def under_load(interval: CarInterval, load: Load, side_force_arm_m: float) -> CarInterval:
    """Return an interval with other disturbances."""
    return interval._replace(
        side_force_n=load.side_force_n,
        yaw_moment_n_m=load.yaw_moment_n_m + load.side_force_n * side_force_arm_m,
        steering_offset_rad=load.steering_offset_rad,
        friction=load.friction,
    )


def _or_infinite(limit: float | None) -> float:
    return math.inf if limit is None else limit
