"""FRONTIER.toml: the delays, and the demands that every structure meets alike."""

from typing import Annotated, NamedTuple, Self

from pydantic import AfterValidator, Field, PositiveFloat, model_validator

from ....controller.filters.settings import QKind
from ....runtime.settings import Settings
from ..specification import CourseTable, DelayMs, SearchTable


class Structure(NamedTuple):
    """What a law consists of.

    ``law``          in the settings of the controller
    ``reads``        beside the lateral error
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


class FrontierSettings(Settings):
    """All of FRONTIER.toml."""

    delays_ms: Annotated[tuple[DelayMs, ...], Field(min_length=1, max_length=20)]
    margin_share: Annotated[float, Field(ge=0.0, le=2.0)] = 0.3
    """Every corner is stable up to a delay longer by this share."""
    rate_hz: Annotated[float, Field(ge=10.0, le=1000.0)] = 100.0
    peak_sensitivity_max: Annotated[float, Field(gt=1.0, le=100.0)] = 2.9
    noise_gain_rad_m_max: PositiveFloat = 3.2
    """Standard deviation of the steer for white noise of 1 m standard deviation."""
    ignore_s: Annotated[float, Field(ge=0.0, le=600.0)] = 5.0
    """At the start of each run, while it settles on the path."""
    predictor_generations: Annotated[int, Field(ge=1, le=10_000)] = 12
    structures: Annotated[tuple[StructureName, ...], Field(min_length=1)] = tuple(STRUCTURES)
    course: CourseTable
    search: SearchTable = SearchTable()

    @model_validator(mode="after")
    def _refuse_delays_out_of_order(self) -> Self:
        if list(self.delays_ms) != sorted(set(self.delays_ms)) or self.delays_ms[0] <= 0.0:
            raise ValueError("delays_ms must be above 0 and ascend")
        return self
