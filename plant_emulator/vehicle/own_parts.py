"""Parts of the rig that another package may provide: latency model, path, vehicle, disturbance.

Each is a record of functions, named in the settings by ``model = "package.module:ATTRIBUTE"``. With
``settings``, a model derived from ``Settings``, it has a table ``own`` beside that key. Every
function takes that table as its last argument, None for a part without one. The functions must
depend on their arguments only, because runs are repeated and compared bit for bit.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, Field, PlainValidator, SerializeAsAny, WithJsonSchema

from ...runtime.settings import Settings
from ...runtime.settings.plugin import PartError, asked, find_part, own_table
from ..network.latency_profile import LATENCY_S_MAX
from ..path.path import Path
from .vehicle import VehicleParams


class VehicleState(NamedTuple):
    """State of (1), see ``plant_emulator.vehicle.vehicle``; also its rates, per second."""

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


class LatencyModel(NamedTuple):
    """Latency of frames: ``quantile(u, mean_s, spread_s, own) -> latency_s``.

    ``u`` is uniform in (0, 1); the latency must not decrease with u, and be 0 to 10 s.
    """

    quantile: Callable[[float, float, float, Any], float]
    settings: type[Settings] | None = None


class PathModel(NamedTuple):
    """A path: ``build(own) -> Path``, made by ``path_through`` or ``path_of_curvature``."""

    build: Callable[[Any], Path]
    settings: type[Settings] | None = None


class VehicleModel(NamedTuple):
    """Equations of motion: ``rates(vehicle, state, input, own) -> (β', r', Δψ', y')``.

    ``vehicle`` is [vehicle] with the present friction. Actuator, path, disturbances and the
    constant speed are the rig's.
    """

    rates: Callable[[VehicleParams, VehicleState, VehicleInput, Any], Sequence[float]]
    settings: type[Settings] | None = None


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


class DisturbanceModel(NamedTuple):
    """Disturbances over time: ``steps(own)`` returns rows as in ``[[disturbance.steps]]``."""

    steps: Callable[[Any], Iterable[DisturbanceStep]]
    settings: type[Settings] | None = None


find_latency_model = partial(find_part, kind=LatencyModel, noun="latency model")
find_path_model = partial(find_part, kind=PathModel, noun="path model")
find_vehicle_model = partial(find_part, kind=VehicleModel, noun="vehicle model")
find_disturbance_model = partial(find_part, kind=DisturbanceModel, noun="disturbance model")
"""Each returns the model at a place; raises ValueError."""


def _checked(find: Callable[[str], Any]) -> Callable[[str], str]:
    def check(place: str) -> str:
        find(place)
        return place

    return check


def _table(find: Callable[[str], Any]) -> Any:
    return PlainValidator(own_table("model", find))


_TABLE_SCHEMA = WithJsonSchema({"type": "object"})
_Table = SerializeAsAny[Settings] | None
OWN_TABLE: Any = Field(default_factory=dict, validate_default=True)
"""Default of a table ``own``, from the part's model."""
LatencyTable = Annotated[_Table, _table(find_latency_model), _TABLE_SCHEMA]
PathTable = Annotated[_Table, _table(find_path_model), _TABLE_SCHEMA]
VehicleTable = Annotated[_Table, _table(find_vehicle_model), _TABLE_SCHEMA]
DisturbanceTable = Annotated[_Table, _table(find_disturbance_model), _TABLE_SCHEMA]
PathPlace = Annotated[str, AfterValidator(_checked(find_path_model))]
VehiclePlace = Annotated[str, AfterValidator(_checked(find_vehicle_model))]
DisturbancePlace = Annotated[str, AfterValidator(_checked(find_disturbance_model))]


def own_quantile(place: str, own: Settings | None) -> Callable[[float, float, float], float]:
    """Return the quantile function of a latency model; it raises PartError."""
    model, what = find_latency_model(place), f"latency model {place}"

    def quantile(u: float, mean_s: float, spread_s: float) -> float:
        latency_s = asked(what, model.quantile, u, mean_s, spread_s, own)
        if not (isinstance(latency_s, float | int) and 0.0 <= latency_s <= LATENCY_S_MAX):
            raise PartError(
                f"{what} gives {latency_s!r} s at u = {u:g}, mean_s = {mean_s:g}, spread_s ="
                f" {spread_s:g} (allowed: number from 0, up to {LATENCY_S_MAX:g})"
            )
        return latency_s

    return quantile


def own_path(place: str, own: Settings | None) -> Path:
    """Return the path of a path model; raises PartError."""
    what = f"path model {place}"
    path = asked(what, find_path_model(place).build, own)
    if not isinstance(path, Path):
        raise PartError(
            f"{what} gives a {type(path).__name__}: it has to be what path_through or"
            " path_of_curvature give"
        )
    return path
