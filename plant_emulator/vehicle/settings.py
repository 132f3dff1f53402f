"""Settings tables `[vehicle]`, `[actuator]` and `[disturbance]`.

Another package may provide the equations of motion (``VehicleModel``); see
``runtime.settings.plugin``.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import Field, field_validator, model_validator

from ...runtime.node import NS_PER_S
from ...runtime.settings import Settings
from ...runtime.settings.plugin import (
    PLUGIN_TABLE,
    TABLE_SCHEMA,
    PluginTable,
    find_part,
    plugin_place,
    plugin_table,
)
from .single_track_model import VehicleParams


class VehicleState(NamedTuple):
    """State of (1) in ``vehicle.single_track_model``; also its rates, per second."""

    side_slip_rad: float
    yaw_rate_rad_s: float
    heading_error_rad: float
    lateral_error_m: float


class VehicleInput(NamedTuple):
    """Inputs of (1): wheel angle behind the actuator, curvature of the path, disturbances."""

    wheel_rad: float
    curvature_1_m: float
    side_slip_disturbance_rad_s: float
    yaw_disturbance_rad_s2: float


class VehicleModel(NamedTuple):
    """Equations of motion: ``rates(vehicle, state, input, own) -> (β', r', Δψ', y')``.

    ``vehicle`` is [vehicle] with the present friction. Actuator, path, disturbances and the
    constant speed remain those of the settings.
    """

    rates: Callable[[VehicleParams, VehicleState, VehicleInput, Any], Sequence[float]]
    settings: type[Settings] | None = None


find_vehicle_model = partial(find_part, kind=VehicleModel, noun="vehicle model")
"""Returns the model at a place; raises ValueError."""


class VehicleSettings(Settings):
    """`[vehicle]`: the vehicle of SAE 2018-01-1086 (19) at nominal speed.

    Table I prints stiffnesses of 195,000 and 50,000 N/rad in front and at the rear, and no distance
    of the preview point. With 190,000, 500,000 and 2 m the five coefficients of (19) come out to
    0.02 %, and the PD row of Table II to 1e-4 m.
    """

    speed_m_s: float = Field(5.0 / 3.6, ge=0.13, le=70.0)
    virtual_mass_kg: float = Field(2000.0, ge=0.1, le=100_000.0)
    yaw_inertia_kg_m2: float = Field(3728.0, ge=1e-4, le=1_000_000.0)
    front_cornering_stiffness_n_rad: float = Field(190_000.0, ge=1.0, le=10_000_000.0)
    rear_cornering_stiffness_n_rad: float = Field(500_000.0, ge=1.0, le=10_000_000.0)
    front_axle_distance_m: float = Field(1.3008, gt=0.0, le=20.0)
    """From the centre of gravity to the front axle."""
    rear_axle_distance_m: float = Field(1.5453, gt=0.0, le=20.0)
    """From the centre of gravity to the rear axle."""
    preview_distance_m: float = Field(2.0, ge=0.0, le=100.0)
    """From the centre of gravity ahead to the point whose lateral error is measured."""
    initial_lateral_error_m: float = Field(0.0, ge=-50.0, le=50.0)
    """Of the preview point; to the left of the path positive."""
    initial_heading_error_rad: float = Field(0.0, ge=-1.0, le=1.0)
    model: Annotated[str, plugin_place(find_vehicle_model)] | None = None
    """Equations of motion of another package (``VehicleModel``), instead of (1)."""
    own: Annotated[PluginTable, plugin_table(find_vehicle_model), TABLE_SCHEMA] = PLUGIN_TABLE


LAG_S_MIN = 1e-6
PUBLISHED: Mapping[str, Mapping[str, float]] = {
        # Defaults of autowarefoundation/autoware.universe, simple_planning_simulator/README.md.
        "autoware": {
            "lag_s": 0.27, "dead_time_s": 0.24, "angle_limit_rad": 1.0, "rate_limit_rad_s": 5.0,
        },
        # Identified on a small electric vehicle: open-rdc/aiformula, pull request 259.
        "aiformula": {"lag_s": 0.12, "dead_time_s": 0.04, "rate_limit_rad_s": 1.396},  # 80°/s
        # Defaults of TUMFTM/Open-Car-Dynamics, ocd_steering_actuator_pt1_cpp.
        "open_car_dynamics": {"lag_s": 0.06, "angle_limit_rad": 0.3, "rate_limit_rad_s": 0.5},
    }  # fmt: skip
"""Actuators with their source."""


class ActuatorSettings(Settings):
    """`[actuator]`: ideal by default; a limit that is omitted does not exist."""

    published: Literal["autoware", "aiformula", "open_car_dynamics"] | None = None
    """An actuator with its source (``PUBLISHED``); its values replace those of the other keys."""
    lag_s: float = Field(0.0, ge=0.0, le=10.0)
    """0, or at least a microsecond: the motion resolves a nanosecond. With `[car.rack]` that of
    its position loop."""
    dead_time_s: float = Field(0.0, ge=0.0, le=1.0)
    """From a command in effect, as STEERING_STATUS says, to the beginning of its motion."""
    angle_limit_rad: float | None = Field(None, gt=0.0, le=1.5)
    rate_limit_rad_s: float | None = Field(None, ge=0.001, le=100.0)
    dead_band_rad: float = Field(0.0, ge=0.0, le=0.5)

    @model_validator(mode="before")
    @classmethod
    def _is_as_published(cls, given: Any) -> Any:
        name = given.get("published") if isinstance(given, dict) else None
        return given | PUBLISHED.get(str(name), {}) if name is not None else given

    @field_validator("lag_s")
    @classmethod
    def _is_none_or_can_be_computed(cls, lag_s: float) -> float:
        if 0.0 < lag_s < LAG_S_MIN:
            raise ValueError(f"must be 0 or {LAG_S_MIN:g} to 10, not {lag_s:g}")
        return lag_s

    @property
    def dead_time_ns(self) -> int:
        """The dead time [ns]."""
        return round(self.dead_time_s * NS_PER_S)


class DisturbanceStep(Settings):
    """One `[[disturbance.steps]]`, from ``at_s`` on; omitted values do not change."""

    at_s: float = Field(ge=0.0, le=1e6)
    """After the start of motion."""
    side_force_n: float | None = Field(None, ge=-1e6, le=1e6)
    """Side wind or bank, to the left positive."""
    yaw_moment_n_m: float | None = Field(None, ge=-1e6, le=1e6)
    """For instance split braking; to the left positive."""
    steering_offset_rad: float | None = Field(None, ge=-0.5, le=0.5)
    """Added to the front wheel angle behind the actuator and its sensor."""
    friction: float | None = Field(None, ge=0.05, le=2.0)
    """Factor on both cornering stiffnesses; 1 at the start."""


class DisturbanceSettings(Settings):
    """`[disturbance]`: none by default, apart from the curvature of the path."""

    side_force_arm_m: float = Field(0.0, ge=-20.0, le=20.0)
    """Where the side force acts, ahead of the centre of gravity."""
    steps: tuple[DisturbanceStep, ...] = Field((), max_length=10_000)

    @model_validator(mode="after")
    def _steps_follow_each_other(self) -> Self:
        times = [step.at_s for step in self.steps]
        for earlier, later in pairwise(times):
            if later <= earlier:
                raise ValueError(f"steps must follow each other in time: {later} after {earlier}")
        frictions = {step.friction for step in self.steps if step.friction is not None}
        if len(frictions) > 16:
            raise ValueError(f"at most 16 different values of friction, not {len(frictions)}")
        return self
