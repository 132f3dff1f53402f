"""Settings table `[path]`: one for each kind of path, also that of another package."""

from collections.abc import Callable
from functools import partial
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from ...runtime.settings import Settings
from ...runtime.settings.plugin import (
    PLUGIN_TABLE,
    TABLE_SCHEMA,
    PartError,
    PluginTable,
    call_part,
    find_part,
    plugin_place,
    plugin_table,
)
from .path import Path


class PathModel(NamedTuple):
    """A path: ``build(own) -> Path``, made by ``path_through`` or ``path_of_curvature``."""

    build: Callable[[Any], Path]
    settings: type[Settings] | None = None


find_path_model = partial(find_part, kind=PathModel, noun="path model")
"""Returns the model at a place; raises ValueError."""


def plugin_path(place: str, own: Settings | None) -> Path:
    """Return the path of a path model; raises PartError."""
    what = f"path model {place}"
    path = call_part(what, find_path_model(place).build, own)
    if not isinstance(path, Path):
        raise PartError(
            f"{what} gives a {type(path).__name__}: it has to be what path_through or"
            " path_of_curvature give"
        )
    return path


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


class CorridorSettings(Settings):
    """`[path]`: the corridor of ISO 3888-1, in which the vehicle's body has to stay.

    The path within leads from lane to lane as gently as half of the free space allows.
    """

    kind: Literal["iso_3888_1"] = "iso_3888_1"
    start_m: float = Field(50.0, ge=15.0, le=100_000.0)
    """Straight road before the first cone."""
    offset_m: float = Field(3.5, ge=1.0, le=4.0)
    """Between the right edges of sections 1 and 3, to the left."""
    width_m: float = Field(1.85, ge=1.0, le=3.0)
    """Of the vehicle without its mirrors, for which the cones are placed."""
    front_m: float = Field(2.25, ge=0.1, le=10.0)
    """From the centre of gravity to the front of the body."""
    rear_m: float = Field(2.6, ge=0.1, le=10.0)
    """From the centre of gravity to the rear of the body."""


class WaypointSettings(Settings):
    """`[path]`: a smooth curve through the points of a file."""

    kind: Literal["waypoints"] = "waypoints"
    file: FilePath
    """CSV with the header x_m,y_m; relative to the directory the program runs in."""
    closed: bool = False
    """Whether the path continues from the last point to the first."""
    spacing_min_m: Annotated[float, Field(ge=1e-3, le=100.0)] = 1e-3
    """A point nearer to the one kept before is left out: more than a receiver wanders at rest."""


class PluginPathSettings(Settings):
    """`[path]`: a path of another package."""

    kind: Literal["own"] = "own"
    model: Annotated[str, plugin_place(find_path_model)]
    """``package.module:ATTRIBUTE`` of a ``PathModel``."""
    own: Annotated[PluginTable, plugin_table(find_path_model), TABLE_SCHEMA] = PLUGIN_TABLE


PathSettings = Annotated[
    StraightSettings
    | CircleSettings
    | EllipseSettings
    | SingleLaneChangeSettings
    | DoubleLaneChangeSettings
    | CorridorSettings
    | WaypointSettings
    | PluginPathSettings,
    Field(discriminator="kind"),
]
"""`[path]`: one table per kind of path."""
