"""Settings tables of the rig: vehicle, actuator, path, disturbance, sensor noise.

Checked here once, at the edge; the modules that compute take plain records and functions.
"""

from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from typing import Self

from pydantic import Field, NonNegativeFloat, model_validator

from runtime.settings import Settings


class VehicleSettings(Settings):
    """`[vehicle]`: Table I of SAE 2018-01-1086 at nominal speed, with its dropped zero restored.

    Printed is a rear cornering stiffness of 50,000 N/rad. With that, the mass trend of the paper's
    Table II has the wrong sign; with 500,000 N/rad its PD row comes out to 1e-4 m. The distance of
    the preview point is not printed: 1.912 m is what the leading coefficient of (19) implies.
    """

    speed_km_h: float = Field(5.0, ge=0.5, le=250.0)
    virtual_mass_kg: float = Field(2000.0, ge=100.0, le=100_000.0)
    yaw_inertia_kg_m2: float = Field(3728.0, ge=100.0, le=1_000_000.0)
    front_cornering_stiffness_n_rad: float = Field(195_000.0, ge=1000.0, le=10_000_000.0)
    rear_cornering_stiffness_n_rad: float = Field(500_000.0, ge=1000.0, le=10_000_000.0)
    front_axle_m: float = Field(1.3008, gt=0.0, le=20.0)
    """From the centre of gravity to the front axle."""
    rear_axle_m: float = Field(1.5453, gt=0.0, le=20.0)
    """From the centre of gravity to the rear axle."""
    preview_m: float = Field(1.912, ge=0.0, le=100.0)
    """From the centre of gravity to the point whose lateral error is measured."""


class ActuatorSettings(Settings):
    """`[actuator]`: transparent by default; a limit that is not set does not exist."""

    lag_s: float = Field(0.0, ge=0.0, le=10.0)
    angle_limit_rad: float | None = Field(None, gt=0.0, le=1.5)
    rate_limit_rad_s: float | None = Field(None, ge=0.001, le=100.0)
    dead_band_rad: float = Field(0.0, ge=0.0, le=0.5)


class PathKind(StrEnum):
    """The shapes a path can have."""

    STRAIGHT = "straight"
    CIRCLE = "circle"
    ELLIPSE = "ellipse"
    SINGLE_LANE_CHANGE = "single_lane_change"
    DOUBLE_LANE_CHANGE = "double_lane_change"
    WAYPOINTS = "waypoints"


class PathSettings(Settings):
    """`[path]`: one flat table, so that a later layer can change ``kind`` alone.

    Keys of the other kinds are checked but not used. The default ellipse has the axes that
    reproduce the PD row of the paper's Table II; its text does not give them.
    """

    kind: PathKind = PathKind.ELLIPSE
    radius_m: float = Field(50.0, ge=3.0, le=100_000.0)
    """Circle, turned to the left."""
    semi_major_axis_m: float = Field(78.2, ge=3.0, le=100_000.0)
    """Ellipse; the path starts at this axis' end."""
    semi_minor_axis_m: float = Field(41.74, ge=3.0, le=100_000.0)
    lane_change_start_m: float = Field(10.0, ge=0.0, le=100_000.0)
    """Lane changes: straight road before the manoeuvre."""
    lane_change_offset_m: float = Field(3.5, ge=-20.0, le=20.0)
    """Lane changes: to the left positive. ISO 3888-1 moves 3.5 m."""
    lane_change_length_m: float = Field(30.0, ge=1.0, le=10_000.0)
    """Lane changes: along the road, from one lane to the other. ISO 3888-1 has 30 m."""
    waypoint_file: Path = Path("waypoints.csv")
    """Waypoints: CSV with the header x_m,y_m."""
    waypoints_closed: bool = False
    """Waypoints: whether the last point joins the first."""

    @model_validator(mode="after")
    def _fits_its_kind(self) -> Self:
        """Refuse what only together makes no path."""
        if self.kind is PathKind.ELLIPSE:
            ratio = self.semi_major_axis_m / self.semi_minor_axis_m
            if not 1.0 <= ratio <= 10.0:
                raise ValueError(
                    "semi_major_axis_m must be 1 to 10 times semi_minor_axis_m, "
                    f"not {self.semi_major_axis_m} to {self.semi_minor_axis_m}"
                )
        if abs(self.lane_change_offset_m) > 0.5 * self.lane_change_length_m:
            raise ValueError(
                "lane_change_offset_m must not exceed half of lane_change_length_m, "
                f"not {self.lane_change_offset_m} in {self.lane_change_length_m}"
            )
        return self


class DisturbanceStep(Settings):
    """One `[[disturbance.steps]]`: from ``at_s`` on; what is not given keeps its value."""

    at_s: NonNegativeFloat
    """After the start of motion."""
    side_force_n: float | None = Field(None, ge=-1e6, le=1e6)
    """Side wind or bank, to the left positive."""
    yaw_moment_n_m: float | None = Field(None, ge=-1e6, le=1e6)
    """Split braking, for instance; to the left positive."""
    steering_offset_rad: float | None = Field(None, ge=-0.5, le=0.5)
    """Added to the front wheel angle behind the actuator and its sensor."""
    friction: float | None = Field(None, ge=0.05, le=2.0)
    """Factor on both cornering stiffnesses; 1 at the start."""


class DisturbanceSettings(Settings):
    """`[disturbance]`: none by default; beside these, the path's curvature disturbs the vehicle."""

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


class SensorNoiseSettings(Settings):
    """`[sensor_noise]`: standard deviations of white Gaussian noise on each sample."""

    lateral_error_m: float = Field(0.0, ge=0.0, le=10.0)
    heading_error_rad: float = Field(0.0, ge=0.0, le=1.0)
    yaw_rate_rad_s: float = Field(0.0, ge=0.0, le=1.0)
