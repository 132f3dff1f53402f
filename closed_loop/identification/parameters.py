"""Parameters of a drive: what is sought of car, steering and sensors, and what is known before.

    c   cornering stiffness over load, of an axle     [1/rad]     C = c F_z
    j   yaw inertia over m l_f l_r                    [1]         J = j m l_f l_r
    μ   friction; σ relaxation length of both axles   [1], [m]
    T   lag of the steering; D its dead time          [s]         sought are T² and D + T

At a given D + T a small T acts as T² does, so T itself would have no sensitivity at 0.

A log of steering and motion has no force in it, so it says nothing of the mass: all of these are
per kilogram. Nor does it separate geometry from stiffness. What ``Known`` leaves open of wheelbase,
centre of gravity and driven axle is assumed, not sought, because a model's error would be taken for
it; the spread of the assumption goes into every interval. The driving force is small, but in front
it turns the car like a stiffer tyre. A sensor has an offset and a gain with priors, and a delay
after the first yaw rate; the delay of that one is part of D.
"""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from ...plant_emulator.path.drivability import GRAVITY_M_S2
from ...plant_emulator.vehicle.car.settings import CarSettings
from ...plant_emulator.vehicle.settings import VehicleSettings
from ...runtime.array_types import FloatArray
from ...runtime.settings import Settings
from .time_series import Channel, Drive, Quantity

MASS_KG = 1500.0
"""Chosen where the mass is not known: it is in no figure per kilogram."""
_STIFFNESS_N_RAD_MAX = 1e7
"""Of `VehicleSettings`."""
FRICTION_MAX = 2.9
"""As good as none: tyres are linear up to it."""
_WHEELBASE_M, _WHEELBASE_SPREAD = 2.75, 0.08
LONG_WHEELBASE_M, _LONG_SHARE_SPREAD = 4.0, 0.15
_FRONT_SHARE, _FRONT_SHARE_SPREAD = 0.45, 0.05
_DRIVE_FRONT, _DRIVE_FRONT_SPREAD = 0.5, 0.5
"""With the relative and the absolute standard deviations: the share is that of the seven passenger
cars among the presets, not so of a lorry or bus, which is long; the rest is chosen."""
_DRAG_1_M = CarSettings().drag_n_s2_m2 / MASS_KG


class Known(Settings):
    """What is known of the car before; all may be left out."""

    mass_kg: float | None = Field(None, ge=0.1, le=100_000.0)
    yaw_inertia_kg_m2: float | None = Field(None, ge=1e-4, le=1e6)
    wheelbase_m: float | None = Field(None, ge=0.1, le=20.0)
    front_axle_distance_m: float | None = Field(None, gt=0.0, le=20.0)
    """From the centre of gravity."""
    steering_ratio: float | None = Field(None, ge=0.1, le=100.0)
    """Angle of the hand wheel over that of the front wheels."""
    cg_height_m: float = Field(0.55, ge=0.0, le=5.0)
    lateral_acceleration_ahead_m: float = Field(0.0, ge=-10.0, le=10.0)
    """Where its sensor is, ahead of the centre of gravity."""
    drive_front: float | None = Field(None, ge=0.0, le=1.0)
    """Share of the driving force."""
    friction: float | None = Field(None, ge=0.05, le=3.0)
    tyre: Literal["fiala", "magic_formula"] = "fiala"

    @model_validator(mode="after")
    def _refuse_contradictions(self) -> Self:
        if self.yaw_inertia_kg_m2 is not None and self.mass_kg is None:
            raise ValueError("yaw_inertia_kg_m2 needs mass_kg")
        if self.front_axle_distance_m is not None and self.wheelbase_m is None:
            raise ValueError("front_axle_distance_m needs wheelbase_m")
        if (self.front_axle_distance_m or 0.0) >= (self.wheelbase_m or np.inf):
            raise ValueError("front_axle_distance_m must be below wheelbase_m")
        return self


class Parameter(NamedTuple):
    """One that is sought.

    ``is_log``     sought by its logarithm, as are its limits and its scale
    ``scale``      a usual change
    ``deviation``  standard deviation of its prior around ``start``; infinite for none
    ``unsure``     standard deviation of an error that is the same in every sample, so none shows it
    """

    name: str
    low: float
    high: float
    start: float
    scale: float
    is_log: bool = False
    deviation: float = np.inf
    unsure: float = 0.0

    def value(self, x: float) -> float:
        """Return the value of a coordinate of the search."""
        return float(np.exp(x)) if self.is_log else float(x)


def _log(name: str, low: float, high: float, start: float, deviation: float = np.inf) -> Parameter:
    low, high, start = np.log((low, high, start)).tolist()
    return Parameter(name, low, high, start, 0.1, is_log=True, deviation=deviation)


class Problem(NamedTuple):
    """The parameters that are sought and those that are held."""

    parameters: tuple[Parameter, ...]
    assumed: tuple[Parameter, ...]
    """Held at their start, with the deviation of their prior."""
    held: Mapping[str, float]
    known: Known
    sensors: tuple[str, ...]
    """Names of the outputs, the first yaw rate first."""

    @property
    def start(self) -> FloatArray:
        """Where the search starts."""
        return np.array([one.start for one in self.parameters])

    @property
    def coordinates(self) -> tuple[Parameter, ...]:
        """Those sought, then those assumed."""
        return (*self.parameters, *self.assumed)

    def values(self, x: Sequence[float] | FloatArray) -> dict[str, float]:
        """Return all parameters by name; behind those sought may stand those assumed."""
        named = zip(self.coordinates, x, strict=False)
        sought = {one.name: one.value(c) for one, c in named}
        return {**self.held, **{one.name: one.value(one.start) for one in self.assumed}, **sought}

    def holding(self, values: Mapping[str, float]) -> "Problem":
        """Return the problem with some parameters held."""
        left = tuple(one for one in self.parameters if one.name not in values)
        return self._replace(parameters=left, held={**self.held, **values})

    def seeking(self) -> "Problem":
        """Return the problem with what is assumed sought too, with its prior."""
        its = {one.name for one in self.assumed}
        held = {key: value for key, value in self.held.items() if key not in its}
        return self._replace(parameters=self.coordinates, assumed=(), held=held)

    def of_long_vehicle(self) -> "Problem":
        """Return the problem of a lorry or bus, whose centre of gravity is less well assumed."""
        wide = {"front_share": _LONG_SHARE_SPREAD}
        assumed = [it._replace(deviation=wide.get(it.name, it.deviation)) for it in self.assumed]
        return self._replace(assumed=tuple(assumed))

    def place(self, name: str) -> int:
        """Return the place of a parameter."""
        return [one.name for one in self.parameters].index(name)


def problem_of(drive: Drive, known: Known) -> Problem:
    """Return what is sought in a drive."""
    wheelbase_m = known.wheelbase_m or _WHEELBASE_M
    share = (known.front_axle_distance_m or _FRONT_SHARE * wheelbase_m) / wheelbase_m
    sees_wheel = drive.steering.quantity is Quantity.WHEEL
    inertia = None
    if known.yaw_inertia_kg_m2 and known.mass_kg:
        arms_m2 = share * (1.0 - share) * wheelbase_m**2
        inertia = known.yaw_inertia_kg_m2 / known.mass_kg / arms_m2
    told = {
        "front_share": share,
        "wheelbase_m": known.wheelbase_m,
        "inertia": inertia,
        "friction": known.friction,
        "drive_front": known.drive_front,
        "steering_ratio": 1.0 if sees_wheel else known.steering_ratio,
    }
    held = {name: value for name, value in told.items() if value is not None}

    def unsure_s(other: Channel) -> float:
        return float(np.hypot(drive.outputs[0].unsure_s, other.unsure_s))

    turning_ratio = wheel_over_turning_m(drive) / wheelbase_m
    c_max = min(150.0, _STIFFNESS_N_RAD_MAX / GRAVITY_M_S2 / (known.mass_kg or MASS_KG))
    parameters = [
        _log("wheelbase_m", 0.1, 15.0, wheelbase_m),
        _log("front_c", 1.0, c_max, 15.0),
        _log("rear_c", 1.0, c_max, 20.0),
        _log("inertia", 0.2, 4.0, inertia or 1.0),
        _log("friction", 0.05, FRICTION_MAX, 1.0),
        _log("relaxation_m", 0.005, 4.0, 0.4),
        Parameter("delay_and_lag_s", -0.15, 0.9, 0.03, 0.02, unsure=unsure_s(drive.steering)),
        Parameter("lag_squared_s2", 0.0, 0.36, 4e-4, 4e-4),
        _log("steering_ratio", 0.2, 80.0, float(np.clip(0.8 * turning_ratio, 0.3, 70.0))),
        Parameter("steering_offset_rad", -1.0, 1.0, 0.0, 0.005),
        Parameter("yaw_rate_offset_rad_s", -0.2, 0.2, 0.0, 0.002, deviation=0.01),
    ]  # fmt: skip
    for sensor in drive.outputs[1:]:
        of_rate = sensor.quantity is Quantity.YAW_RATE
        offset, gain = (0.01, 0.02) if of_rate else (0.3, 0.06)
        parameters += [
            Parameter(f"{sensor.name}:offset", -3.0, 3.0, 0.0, 0.1 * offset, deviation=offset),
            Parameter(f"{sensor.name}:gain", 0.5, 1.5, 1.0, 0.02, deviation=gain),
            Parameter(f"{sensor.name}:delay_s", -0.3, 0.3, 0.0, 0.01, unsure=unsure_s(sensor)),
        ]
    assumed = []
    if known.front_axle_distance_m is None:
        spread = _FRONT_SHARE_SPREAD
        assumed.append(Parameter("front_share", 0.2, 0.8, share, 0.02, deviation=spread))
    if known.drive_front is None:
        spread = _DRIVE_FRONT_SPREAD
        assumed.append(Parameter("drive_front", 0.0, 1.0, _DRIVE_FRONT, 0.1, deviation=spread))
    if not held.keys() & {"steering_ratio", "wheelbase_m"}:
        # Turning shows their product alone.
        assumed.append(_log("wheelbase_m", 0.1, 15.0, wheelbase_m, _WHEELBASE_SPREAD))
        held["wheelbase_m"] = wheelbase_m
    sensors = tuple(one.name for one in drive.outputs)
    return Problem(tuple(parameters), tuple(assumed), {}, known, sensors).holding(held)


def wheel_over_turning_m(drive: Drive) -> float:
    """Return the wheel's angle over the curvature that goes with it: ratio times wheelbase [m]."""
    steer, speed = drive.at_yaw_rates()
    turning, rate = speed * (steer - np.median(steer)), drive.outputs[0].values
    slope = float(turning @ (rate - np.median(rate))) / float(turning @ turning)
    return 1.0 / max(slope, 1e-5)


def car_tables(values: Mapping[str, float], known: Known) -> tuple[VehicleSettings, CarSettings]:
    """Return the tables [vehicle] and [car] of a set of parameters.

    The drag is a usual car's for its mass, and the rolling resistance the default.
    """
    mass_kg, wheelbase_m = known.mass_kg or MASS_KG, values["wheelbase_m"]
    front_m = values["front_share"] * wheelbase_m
    rear_m = wheelbase_m - front_m
    weight_n = GRAVITY_M_S2 * mass_kg / wheelbase_m
    vehicle = VehicleSettings(
        virtual_mass_kg=mass_kg,
        yaw_inertia_kg_m2=values["inertia"] * mass_kg * front_m * rear_m,
        front_cornering_stiffness_n_rad=values["front_c"] * weight_n * rear_m,
        rear_cornering_stiffness_n_rad=values["rear_c"] * weight_n * front_m,
        front_axle_distance_m=front_m,
        rear_axle_distance_m=rear_m,
    )
    car = CarSettings(
        tyre=known.tyre,
        friction=values["friction"],
        cg_height_m=known.cg_height_m,
        front_relaxation_m=values["relaxation_m"],
        rear_relaxation_m=values["relaxation_m"],
        drive_front=values["drive_front"],
        drag_n_s2_m2=_DRAG_1_M * mass_kg,
    )
    return vehicle, car


def values_of(vehicle: VehicleSettings, car: CarSettings) -> dict[str, float]:
    """Return the parameters of a car that are in its tables."""
    front_m, rear_m = vehicle.front_axle_distance_m, vehicle.rear_axle_distance_m
    mass_kg, wheelbase_m = vehicle.virtual_mass_kg, front_m + rear_m
    weight_n = GRAVITY_M_S2 * mass_kg / wheelbase_m
    return {
        "wheelbase_m": wheelbase_m,
        "front_share": front_m / wheelbase_m,
        "front_c": vehicle.front_cornering_stiffness_n_rad / (weight_n * rear_m),
        "rear_c": vehicle.rear_cornering_stiffness_n_rad / (weight_n * front_m),
        "inertia": vehicle.yaw_inertia_kg_m2 / (mass_kg * front_m * rear_m),
        "friction": car.friction,
        "relaxation_m": car.front_relaxation_m,
        "drive_front": car.drive_front,
    }
