"""``PlantSettings``: all settings of the plant emulator, in one table for each subject."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ..dbc.codec.counter_rule import CounterRule
from ..runtime.node import NS_PER_MS, NS_PER_S
from ..runtime.node.overruns import OverrunSettings
from ..runtime.settings import (
    Settings,
    SettingsError,
    SharedTable,
    load_settings,
    read_preset,
    read_table,
)
from ..runtime.settings.plugin import Part
from .evaluation.run_verdict import VerdictRules
from .faults.settings import FAULTS_MAX, MOTOR_FAULTS, STEERING_FAULTS, FaultKind, FaultSettings
from .network.settings import BothLatencySettings
from .path.corridor import CORRIDOR_M
from .path.settings import CorridorSettings, EllipseSettings, PathSettings, find_path_model
from .sensors.settings import PathAheadSettings, SensorNoiseSettings, SteeringForceSettings
from .steering.hand_wheel import HandWheelSettings
from .steering.settings import SafetySettings, resync_ns_of
from .vehicle.car.car_choice import find_car_model
from .vehicle.car.rack_settings import LAG_S_MIN
from .vehicle.car.settings import CarSettings
from .vehicle.car.steering_input import Failure, Health
from .vehicle.motion_parameters import motion_params
from .vehicle.moving_vehicle import AnyMotionParams
from .vehicle.settings import ActuatorSettings, DisturbanceSettings, VehicleSettings

PRESETS = "steer_by_wire.plant_emulator.presets"
"""The package with the presets that are shipped."""


def shared_vehicle(file: Path | None) -> SharedTable | None:
    """Return [vehicle] of a file that the controller reads too, and its [car] if there is one.

    Raises SettingsError.
    """
    if file is None:
        return None
    car = read_table(file, "car", {})
    tables = {"vehicle": read_table(file, "vehicle")} | ({"car": car} if car else {})
    return SharedTable(str(file), tables)


def refuse_vehicle(file: Path | None) -> None:
    """Raise SettingsError for the file of a vehicle in the place of a plant's settings."""
    if file is not None and read_table(file, "uncertainty", {}):
        raise SettingsError(
            f"{file}: has [uncertainty], so it describes a vehicle: give it as --vehicle"
        )


class PlantSettings(Settings):
    """One run of the plant; its random numbers depend on these settings alone."""

    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 1
    duration_s: Annotated[float, Field(gt=0.0, le=1e6)] = 60.0
    """Of motion; then the program ends."""
    sensor_period_ms: Annotated[float, Field(ge=1.0, le=500.0)] = 10.0
    """Between two LATERAL_ERROR, and two STEERING_STATUS."""
    start_on_first_command: bool = True
    """Whether the vehicle stands until a valid command arrives on the bus."""
    counter_lead_ms: Annotated[float, Field(ge=0.0, le=10_000.0)] = 40.0
    """How much earlier a command may come than the time since the newest one explains: as much as a
    tick of its sender may be late, since a bus keeps the order of frames."""
    resync_frames: Annotated[int, Field(ge=1, le=100)] = 5
    """Commands in a row with consecutive counters after which a new sender is accepted."""
    vehicle: VehicleSettings = VehicleSettings()
    car: CarSettings | None = None
    """Makes it a car with tyres and a speed of its own; if omitted, the vehicle is linear."""
    actuator: ActuatorSettings = ActuatorSettings()
    path: PathSettings = EllipseSettings()
    disturbance: DisturbanceSettings = DisturbanceSettings()
    sensor_noise: SensorNoiseSettings = SensorNoiseSettings()
    path_ahead: PathAheadSettings | None = None
    """Send PATH_AHEAD, which needs CAN FD; if omitted, the controller knows only the curvature
    at the preview point."""
    ground_truth: bool = False
    """Whether GROUND_TRUTH, and CAR_TRUTH of a car, are sent with each sample, for monitors."""
    steering_force: SteeringForceSettings | None = None
    """Send STEERING_FORCE; if omitted, no one is told the force on the rack."""
    hand_wheel: HandWheelSettings | None = None
    """Follow HAND_WHEEL_STATE while the driver steers; if omitted, only commands steer."""
    latency: BothLatencySettings = BothLatencySettings()
    interventions: Literal["allow", "refuse"] = "refuse"
    """Whether tools on the bus may change latency and disturbance during the run, by LATENCY_CONFIG
    and DISTURBANCE_CONFIG. Nothing proves who sent these; a plant with a key refuses them."""
    safety: SafetySettings = SafetySettings()
    verdict: VerdictRules = VerdictRules()
    """Thresholds of the verdict on the run."""
    overruns: OverrunSettings = OverrunSettings()
    """Overruns of the sensors; with more, the plant counts as too slow and ends safely."""
    faults: tuple[FaultSettings, ...] = Field((), max_length=FAULTS_MAX)
    """Of frames to and from the plant (``plant_emulator.faults.stage``), and of its steering."""

    @model_validator(mode="after")
    def _passes_the_corridor(self) -> Self:
        """Refuse a run whose verdict would be on a part of its corridor, or on swings within it."""
        if isinstance(self.path, CorridorSettings):
            end_m = self.path.start_m + CORRIDOR_M + self.path.rear_m
            end_s = (end_m + self.vehicle.preview_distance_m) / self.vehicle.speed_m_s
            # The windows of the verdict take up to half of a run.
            if self.duration_s < 2.0 * end_s:
                raise ValueError(
                    f"duration_s must be {math.ceil(20.0 * end_s) / 10.0:g} or more: half for the"
                    " corridor of ISO 3888-1, half for the windows of the verdict behind it, not"
                    f" {self.duration_s:g}"
                )
        return self

    @model_validator(mode="after")
    def _has_a_loop_for_the_rack(self) -> Self:
        """Refuse a rack whose position loop has neither a lag nor a largest rate."""
        has_loop = self.actuator.lag_s >= LAG_S_MIN and self.actuator.rate_limit_rad_s is not None
        if self.car is not None and self.car.rack is not None and not has_loop:
            raise ValueError(
                f"car.rack needs actuator.lag_s of {LAG_S_MIN:g} to 10, of its position loop,"
                " and actuator.rate_limit_rad_s of 0.001 to 100"
            )
        return self

    @model_validator(mode="after")
    def _has_one_vehicle_that_can_stop(self) -> Self:
        if self.vehicle.model is not None and self.car is not None:
            raise ValueError(
                "vehicle.model has the equations of the linear vehicle: with a table [car] name a"
                " car.model, or leave [car] out"
            )
        if self.safety.stop_m_s2 is not None and self.car is None:
            raise ValueError(
                "safety.stop_m_s2 needs a table [car]: the linear vehicle cannot brake"
            )
        return self

    @model_validator(mode="after")
    def _has_the_steering_that_fails(self) -> Self:
        for number, fault in enumerate(self.faults):
            needed = "car" if fault.kind in STEERING_FAULTS else ""
            needed = "car.rack" if fault.kind in MOTOR_FAULTS else needed
            if (needed and self.car is None) or (
                needed == "car.rack" and self.car is not None and self.car.rack is None
            ):
                raise ValueError(f"faults[{number}]: {fault.kind} needs a table [{needed}]")
        return self

    @property
    def steering_failures(self) -> tuple[Failure, ...]:
        """The faults of the steering, for its motion."""
        return tuple(_failure(fault) for fault in self.faults if fault.kind in STEERING_FAULTS)

    @property
    def duration_ns(self) -> int:
        """Length of the motion [ns]."""
        return round(self.duration_s * NS_PER_S)

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts of your own in path and car, as their places are now.

        What is kept for equal settings depends on them too: a notebook may define one again.
        """
        places = (
            (find_path_model, getattr(self.path, "model", None)),
            (find_car_model, None if self.car is None else self.car.model),
        )
        return tuple(find(place) for find, place in places if place is not None)

    @property
    def counters(self) -> CounterRule:
        """Which counters of the commands are accepted."""
        lead_ns = round(self.counter_lead_ms * NS_PER_MS)
        return CounterRule(lead_ns, self.resync_frames, resync_ns_of(self.safety))

    @property
    def sensor_period_ns(self) -> int:
        """Period of the sensors [ns]."""
        return round(self.sensor_period_ms * NS_PER_MS)

    @property
    def force_period_ns(self) -> int:
        """Period of STEERING_FORCE [ns], 0 where it is not sent."""
        force = self.steering_force
        return 0 if force is None else round(force.period_ms * NS_PER_MS)


def _failure(fault: FaultSettings) -> Failure:
    start_ns = round(fault.onset_s * NS_PER_S)
    left = {
        FaultKind.WEAK_MOTOR: Health(torque_share=fault.magnitude),
        FaultKind.LOST_CHANNEL: Health(torque_share=0.5, resistance_factor=2.0),
        FaultKind.SLOW_WHEEL: Health(rate_share=fault.magnitude),
        FaultKind.STUCK_WHEEL: Health(rate_share=0.0),
        FaultKind.REVERSED_WHEEL: Health(command_factor=-1.0),
        FaultKind.OFFSET_SENSOR: Health(sensor_rad=fault.magnitude),
        FaultKind.DRIFTING_SENSOR: Health(sensor_rad_s=fault.magnitude),
    }[fault.kind]
    return Failure(start_ns, start_ns + round(fault.duration_s * NS_PER_S), left)


def plant_motion_params(settings: PlantSettings) -> AnyMotionParams:
    """Return the constants of the motion; raises what ``motion_params`` raises."""
    driven = settings.vehicle, settings.actuator, settings.path, settings.disturbance
    return motion_params(*driven, settings.car, settings.steering_failures)


def plant_preset(name: str, overrides: Sequence[str] = ()) -> PlantSettings:
    """Return the settings of a preset, with ``overrides`` as for ``load_settings`` on top.

    Raises SettingsError.
    """
    return load_settings(PlantSettings, read_preset(PRESETS, name), overrides=overrides)
