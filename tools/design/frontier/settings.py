"""FRONTIER.toml: the delays, and the demands that every structure meets alike."""

from typing import Annotated, NamedTuple, Self

from pydantic import Field, PositiveFloat, model_validator

from ....controller.filters.settings import QKind
from ....runtime.settings import Settings
from ..specification import CourseTable, DelayMs, SearchTable


class Structure(NamedTuple):
    """What a law consists of.

    ``law``        in the settings of the controller
    ``takes_map``  whether the curvature of the map is added, by [feed_forward]
    ``q_kinds``    filters of the DOB, of which the better one is taken
    """

    law: str
    takes_map: bool = False
    q_kinds: tuple[QKind, ...] = ("type_2",)


STRUCTURES = {
    "PD": Structure("pd"),
    "PD + map": Structure("pd", takes_map=True),
    "PD + CDOB": Structure("pd_cdob"),
    "PD + DOB": Structure("pd_dob", q_kinds=("type_2", "order_2")),
    "PD + DDOB": Structure("pd_ddob", q_kinds=("type_2", "order_2")),
    "PID": Structure("pid"),
    "PID + heading": Structure("pid_heading"),
}
"""All that the linear search can design. The map's curvature comes from VEHICLE_STATE; apart from
that and the heading error, each reads the lateral error and its own commands only."""


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
    course: CourseTable
    search: SearchTable = SearchTable()

    @model_validator(mode="after")
    def _refuse_delays_out_of_order(self) -> Self:
        if list(self.delays_ms) != sorted(set(self.delays_ms)) or self.delays_ms[0] <= 0.0:
            raise ValueError("delays_ms must be above 0 and ascend")
        return self
