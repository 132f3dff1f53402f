"""Settings table `[car]`: what a car has besides `[vehicle]`; without it the plant is linear.

Mass, yaw inertia, axle distances, preview distance and the cornering stiffness of each axle at rest
are those of `[vehicle]`, whose ``virtual_mass_kg`` is the mass here.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ....runtime.settings import Settings
from ....runtime.settings.plugin import (
    PLUGIN_TABLE,
    TABLE_SCHEMA,
    PluginTable,
    plugin_place,
    plugin_table,
)
from ...path.corridor import Lane
from .car_choice import find_car_model
from .rack_settings import RackSettings

FASTEST_M_S = 70.0


class SpeedPoint(Settings):
    """One `[[car.speed]]`: the speed at a time or an arc length of the centre of gravity."""

    at_s: float | None = Field(None, ge=0.0, le=1e6)
    at_m: float | None = Field(None, ge=0.0, le=1e8)
    speed_m_s: float = Field(le=FASTEST_M_S)

    @model_validator(mode="after")
    def _has_one_place(self) -> Self:
        if self.speed_m_s < 0.0:
            raise ValueError(
                f"speed_m_s = {self.speed_m_s:g}: the car has no reverse gear; 0 to {FASTEST_M_S:g}"
            )
        if (self.at_s is None) == (self.at_m is None):
            raise ValueError("needs at_s or at_m, and not both")
        return self


class GripSettings(Settings):
    """One `[[car.grip]]`: the road from an arc length of the centre of gravity on."""

    from_m: float = Field(ge=0.0, le=1e8)
    """Along the path from its start, over all laps."""
    friction: float = Field(ge=0.02, le=2.0)
    """A factor on ``car.friction``; 1 before the first."""


class CarSettings(Settings):
    """`[car]`; the defaults are those of a passenger car, all chosen."""

    friction: float = Field(1.0, ge=0.02, le=3.0)
    """μ of tyre and road."""
    cg_height_m: float = Field(0.55, ge=0.0, le=5.0)
    front_relaxation_m: float = Field(0.4, ge=0.001, le=5.0)
    rear_relaxation_m: float = Field(0.4, ge=0.001, le=5.0)
    tyre: Literal["fiala", "magic_formula"] = "fiala"
    magic_shape: float = Field(1.3, ge=1.0, le=2.0)
    """c of the Magic Formula; E is ``magic_curvature``."""
    magic_curvature: float = Field(0.0, ge=-10.0, le=1.0)
    drive_front: float = Field(1.0, ge=0.0, le=1.0)
    """Share of the driving force; the rest drives the rear axle."""
    brake_front: float = Field(0.65, ge=0.0, le=1.0)
    drive_force_n_max: float = Field(5000.0, ge=0.0, le=1e6)
    brake_force_n_max: float = Field(15_000.0, ge=0.0, le=1e6)
    jerk_m_s3_max: float = Field(5.0, ge=0.01, le=1000.0)
    speed_gain_1_s: float = Field(1.0, ge=0.01, le=100.0)
    drag_n_s2_m2: float = Field(0.4, ge=0.0, le=1000.0)
    """Force over the square of the speed."""
    rolling_resistance: float = Field(0.01, ge=0.0, le=0.5)
    """Force over weight."""
    front_m: float = Field(2.0, gt=0.0, le=20.0)
    """From the centre of gravity to the front of the body."""
    rear_m: float = Field(2.5, gt=0.0, le=20.0)
    width_m: float = Field(1.8, gt=0.0, le=5.0)
    lane_m: float = Field(3.5, gt=0.0, le=100.0)
    """Width of the lane, with the path in its middle, in which the verdict wants the body."""
    speed: tuple[SpeedPoint, ...] = Field((), max_length=10_000)
    """The profile; if omitted, ``vehicle.speed_m_s`` all the time."""
    grip: tuple[GripSettings, ...] = Field((), max_length=10_000)
    rack: RackSettings | None = None
    """If omitted, the wheels follow as `[actuator]` says."""
    model: Annotated[str, plugin_place(find_car_model)] | None = None
    """A car of another package (``CarModel``), with states of its own, instead of the built-in."""
    own: Annotated[PluginTable, plugin_table(find_car_model), TABLE_SCHEMA] = PLUGIN_TABLE

    @model_validator(mode="after")
    def _profile_and_road_have_an_order(self) -> Self:
        if self.speed:
            self._check_profile()
        for earlier, later in pairwise(self.grip):
            if later.from_m <= earlier.from_m:
                raise ValueError(
                    f"grip must follow the road: from_m = {later.from_m:g} after {earlier.from_m:g}"
                )
        return self

    def _check_profile(self) -> None:
        """Raise ValueError for a profile that no car can follow."""
        if len({point.at_s is None for point in self.speed}) > 1:
            raise ValueError("speed needs at_s in every point, or at_m in every point")
        at = [point[0] for point in self.profile]
        if at[0] != 0.0:
            raise ValueError(f"speed must begin at 0, not at {at[0]:g}")
        for earlier, later in pairwise(at):
            if later <= earlier:
                raise ValueError(
                    f"the points of speed must have an order: {later:g} after {earlier:g}"
                )
        if self.is_over_arc_length and not all(point.speed_m_s for point in self.speed[:-1]):
            raise ValueError(
                "speed over at_m may be 0 at the last point only: a car that stands never comes to"
                " the next; use at_s"
            )

    @property
    def lane(self) -> Lane:
        """The lane, and the body in it."""
        return Lane(0.5 * self.lane_m, self.front_m, self.rear_m, 0.5 * self.width_m)

    @property
    def is_over_arc_length(self) -> bool:
        """Whether the profile is one over arc length."""
        return bool(self.speed) and self.speed[0].at_m is not None

    @property
    def profile(self) -> Sequence[tuple[float, float]]:
        """The points: time [s] or arc length [m], and speed [m/s]."""
        return [(point.at_s or point.at_m or 0.0, point.speed_m_s) for point in self.speed]
