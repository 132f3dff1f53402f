"""FRONTIER.toml: the delays, and the demands that every structure meets alike."""

from typing import Annotated, NamedTuple, Self

from pydantic import AfterValidator, Field, PositiveFloat, model_validator

from ....controller.filters.settings import QKind, SpeedMS
from ....runtime.settings import Settings
from ..specification import CourseTable, DelayMs, SearchTable
from ..vehicle_file import VehicleFile


class Structure(NamedTuple):
    """What a law consists of.

    ``law``          in the settings of the controller
    ``reads``        besides the lateral error
    ``follows_car``  whether it has the set point that puts the car on the path
    ``takes_map``    whether the curvature of the map is added, by [feed_forward]
    ``q_kinds``      filters of the DOB, of which the better one is taken
    """

    law: str
    reads: str = "curvature, speed"
    follows_car: bool = True
    takes_map: bool = False
    q_kinds: tuple[QKind, ...] = ("type_2",)


STRUCTURES = {
    "PD, error alone": Structure("pd", "nothing", follows_car=False),
    "PID, error alone": Structure("pid", "nothing", follows_car=False),
    "PD": Structure("pd"),
    "PD + map": Structure("pd", takes_map=True),
    "PD + CDOB": Structure("pd_cdob"),
    "PD + DOB": Structure("pd_dob", q_kinds=("type_2", "order_2")),
    "PD + DDOB": Structure("pd_ddob", q_kinds=("type_2", "order_2")),
    "PID": Structure("pid"),
    "PID + heading": Structure("pid_heading", "curvature, speed, heading"),
    "predictor": Structure("predictor", "curvature, speed, heading, echoes"),
}
"""What is compared. Curvature and speed come from VEHICLE_STATE."""


def _known(name: str) -> str:
    if name not in STRUCTURES:
        raise ValueError(f"is not one of {', '.join(STRUCTURES)}")
    return name


StructureName = Annotated[str, AfterValidator(_known)]


class PanelTable(Settings):
    """`[[panels]]`: a speed, its delays and its paths; the demands are those of all panels.

    ``speed_m_s``             lowest and highest, in place of the vehicle's; none: the vehicle's own
    ``noise_gain_rad_m_max``  standard deviation of the steer for white noise of 1 m standard
                              deviation on the lateral error, and of 0.1 rad on the heading error
    ``predictor``             preset near which the predictor's first starts begin
    ``search``                in place of that of all panels
    ``predictor_generations`` of its search, in place of that of all panels
    """

    name: Annotated[str, Field(min_length=1, max_length=40)]
    speed_m_s: tuple[SpeedMS, SpeedMS] | None = None
    delays_ms: Annotated[tuple[DelayMs, ...], Field(min_length=1, max_length=20)]
    noise_gain_rad_m_max: PositiveFloat
    predictor: str
    search: SearchTable | None = None
    predictor_generations: Annotated[int, Field(ge=1, le=10_000)] | None = None
    course: CourseTable

    def at_speed(self, vehicle: VehicleFile) -> VehicleFile:
        """Return the vehicle at this speed, between the lowest and the highest."""
        if self.speed_m_s is None:
            return vehicle
        return vehicle.at_speeds(0.5 * sum(self.speed_m_s), self.speed_m_s)

    @model_validator(mode="after")
    def _refuse_delays_out_of_order(self) -> Self:
        if list(self.delays_ms) != sorted(set(self.delays_ms)) or self.delays_ms[0] <= 0.0:
            raise ValueError("delays_ms must be above 0 and ascend")
        return self

    @model_validator(mode="after")
    def _refuse_speeds_out_of_order(self) -> Self:
        if self.speed_m_s is not None and not self.speed_m_s[0] < self.speed_m_s[1]:
            raise ValueError("speed_m_s must be [lowest, highest]")
        return self


class FrontierSettings(Settings):
    """All of FRONTIER.toml."""

    margin_share: Annotated[float, Field(ge=0.0, le=2.0)] = 0.3
    """Every corner is stable up to a delay longer by this share."""
    rate_hz: Annotated[float, Field(ge=10.0, le=1000.0)] = 100.0
    peak_sensitivity_max: Annotated[float, Field(gt=1.0, le=100.0)] = 2.9
    ignore_s: Annotated[float, Field(ge=0.0, le=600.0)] = 5.0
    """At the start of each run, while it settles on the path."""
    predictor_generations: Annotated[int, Field(ge=1, le=10_000)] = 12
    structures: Annotated[tuple[StructureName, ...], Field(min_length=1)] = tuple(STRUCTURES)
    search: SearchTable = SearchTable()
    panels: Annotated[tuple[PanelTable, ...], Field(min_length=1, max_length=9)]


class Panel(NamedTuple):
    """What a structure is searched for: the demands, and a panel's own, with its vehicle."""

    asked: FrontierSettings
    table: PanelTable
    vehicle: VehicleFile

    @property
    def search(self) -> SearchTable:
        """How long the search of a structure is."""
        return self.table.search or self.asked.search


def panels_of(asked: FrontierSettings, vehicle: VehicleFile) -> list[Panel]:
    """Return the panels of a frontier for a vehicle."""
    return [Panel(asked, table, table.at_speed(vehicle)) for table in asked.panels]
