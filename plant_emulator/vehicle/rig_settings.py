"""Settings tables of the rig: vehicle, actuator, path, disturbance, sensor noise."""

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from ...runtime.settings import Settings
from ...runtime.settings.plugin import PartError, asked
from .own_parts import (
    OWN_TABLE,
    DisturbancePlace,
    DisturbanceStep,
    DisturbanceTable,
    PathPlace,
    PathTable,
    VehiclePlace,
    VehicleTable,
    find_disturbance_model,
)


class VehicleSettings(Settings):
    """`[vehicle]`: the vehicle of SAE 2018-01-1086 (19) at nominal speed.

    Table I prints stiffnesses of 195,000 and 50,000 N/rad in front and at the rear, and no distance
    of the preview point. With 190,000, 500,000 and 2 m the five coefficients of (19) come out to
    0.02 %, and the PD row of Table II to 1e-4 m.
    """

    speed_m_s: float = Field(5.0 / 3.6, ge=0.13, le=70.0)
    virtual_mass_kg: float = Field(2000.0, ge=100.0, le=100_000.0)
    yaw_inertia_kg_m2: float = Field(3728.0, ge=100.0, le=1_000_000.0)
    front_cornering_stiffness_n_rad: float = Field(190_000.0, ge=1000.0, le=10_000_000.0)
    rear_cornering_stiffness_n_rad: float = Field(500_000.0, ge=1000.0, le=10_000_000.0)
    front_axle_distance_m: float = Field(1.3008, gt=0.0, le=20.0)
    """From the centre of gravity to the front axle."""
    rear_axle_distance_m: float = Field(1.5453, gt=0.0, le=20.0)
    """From the centre of gravity to the rear axle."""
    preview_distance_m: float = Field(2.0, ge=0.0, le=100.0)
    """From the centre of gravity to the point whose lateral error is measured."""
    model: VehiclePlace | None = None
    """Equations of motion of another package (``VehicleModel``), instead of (1)."""
    own: VehicleTable = OWN_TABLE


LAG_S_MIN = 1e-6


class ActuatorSettings(Settings):
    """`[actuator]`: ideal by default; omitted limits do not exist."""

    lag_s: float = Field(0.0, ge=0.0, le=10.0)
    """0, or at least a microsecond, long against the nanosecond of the motion."""
    angle_limit_rad: float | None = Field(None, gt=0.0, le=1.5)
    rate_limit_rad_s: float | None = Field(None, ge=0.001, le=100.0)
    dead_band_rad: float = Field(0.0, ge=0.0, le=0.5)

    @field_validator("lag_s")
    @classmethod
    def _is_none_or_can_be_computed(cls, lag_s: float) -> float:
        if 0.0 < lag_s < LAG_S_MIN:
            raise ValueError(f"must be 0 or {LAG_S_MIN:g} to 10, not {lag_s:g}")
        return lag_s


class StraightSettings(Settings):
    """`[path]`: straight on."""

    kind: Literal["straight"] = "straight"


class CircleSettings(Settings):
    """`[path]`: a circle to the left."""

    kind: Literal["circle"] = "circle"
    radius_m: float = Field(50.0, ge=3.0, le=100_000.0)


class EllipseSettings(Settings):
    """`[path]`: an ellipse to the left, from the end of its major axis, where it bends most.

    The default axes reproduce the PD row of the paper's Table II; the text does not give them.
    """

    kind: Literal["ellipse"] = "ellipse"
    semi_major_axis_m: float = Field(78.2, ge=3.0, le=100_000.0)
    semi_minor_axis_m: float = Field(41.74, ge=3.0, le=100_000.0)

    @model_validator(mode="after")
    def _is_no_needle(self) -> Self:
        """Refuse axes in the wrong order, and ellipses too flat to interpolate."""
        if not 1.0 <= self.semi_major_axis_m / self.semi_minor_axis_m <= 10.0:
            raise ValueError(
                "semi_major_axis_m must be 1 to 10 times semi_minor_axis_m, "
                f"not {self.semi_major_axis_m} to {self.semi_minor_axis_m}"
            )
        return self


class _LaneChangeSettings(Settings):
    start_m: float = Field(10.0, ge=0.0, le=100_000.0)
    """Straight road before the manoeuvre."""
    offset_m: float = Field(3.5, ge=-20.0, le=20.0)
    """From lane to lane, to the left positive. ISO 3888-1 has 3.5 m."""
    length_m: float = Field(30.0, ge=1.0, le=10_000.0)
    """Along the road, from one lane to the other. ISO 3888-1 has 30 m."""

    @model_validator(mode="after")
    def _stays_a_road(self) -> Self:
        if abs(self.offset_m) > 0.5 * self.length_m:
            raise ValueError(
                "offset_m must not exceed half of length_m, "
                f"not {self.offset_m} within {self.length_m}"
            )
        return self


class SingleLaneChangeSettings(_LaneChangeSettings):
    """`[path]`: to the other lane and on."""

    kind: Literal["single_lane_change"] = "single_lane_change"


class DoubleLaneChangeSettings(_LaneChangeSettings):
    """`[path]`: to the other lane and back, in the proportions of ISO 3888-1."""

    kind: Literal["double_lane_change"] = "double_lane_change"


class WaypointSettings(Settings):
    """`[path]`: a smooth curve through the points of a file."""

    kind: Literal["waypoints"] = "waypoints"
    file: Path
    """CSV with the header x_m,y_m; relative to the directory the program runs in."""
    closed: bool = False
    """Whether the path continues from the last point to the first."""


class OwnPathSettings(Settings):
    """`[path]`: a path of another package."""

    kind: Literal["own"] = "own"
    model: PathPlace
    """``package.module:ATTRIBUTE`` of a ``PathModel``."""
    own: PathTable = OWN_TABLE


PathSettings = Annotated[
    StraightSettings
    | CircleSettings
    | EllipseSettings
    | SingleLaneChangeSettings
    | DoubleLaneChangeSettings
    | WaypointSettings
    | OwnPathSettings,
    Field(discriminator="kind"),
]
"""`[path]`: one table per kind of path."""


class DisturbanceSettings(Settings):
    """`[disturbance]`: none by default, besides the path's curvature."""

    side_force_arm_m: float = Field(0.0, ge=-20.0, le=20.0)
    """Where the side force acts, ahead of the centre of gravity."""
    steps: tuple[DisturbanceStep, ...] = Field((), max_length=10_000)
    model: DisturbancePlace | None = None
    """Steps of another package (``DisturbanceModel``), instead of those above."""
    own: DisturbanceTable = OWN_TABLE

    @model_validator(mode="after")
    def _steps_follow_each_other(self) -> Self:
        times = [step.at_s for step in self.steps]
        for earlier, later in pairwise(times):
            if later <= earlier:
                raise ValueError(f"steps must follow each other in time: {later} after {earlier}")
        frictions = {step.friction for step in self.steps if step.friction is not None}
        if len(frictions) > 16:
            raise ValueError(f"at most 16 different values of friction, not {len(frictions)}")
        if self.model is not None:
            if self.steps:
                raise ValueError("steps and model exclude each other")
            _ = self.all_steps
        return self

    @property
    def all_steps(self) -> tuple[DisturbanceStep, ...]:
        """All steps; those of another package may raise PartError."""
        if self.model is None:
            return self.steps
        what = f"disturbance model {self.model}"
        steps = asked(what, lambda: tuple(find_disturbance_model(self.model or "").steps(self.own)))
        try:
            return DisturbanceSettings(steps=steps).steps
        except ValidationError as error:
            mistake = error.errors(include_url=False)[0]
            where = ".".join(map(str, mistake["loc"]))
            raise PartError(f"{what} gives {where or 'steps'}: {mistake['msg']}") from error


class PathAheadSettings(Settings):
    """[path_ahead]: the path ahead on the bus, as a map would know it."""

    reach_s: Annotated[float, Field(gt=0.0, le=10.0)] = 1.5
    """Time at the vehicle's speed that the message reaches ahead; at most 319 m."""


class SensorNoiseSettings(Settings):
    """`[sensor_noise]`: standard deviations of white Gaussian noise on each sample."""

    lateral_error_m: float = Field(0.0, ge=0.0, le=10.0)
    heading_error_rad: float = Field(0.0, ge=0.0, le=1.0)
    yaw_rate_rad_s: float = Field(0.0, ge=0.0, le=1.0)
