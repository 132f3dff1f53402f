"""FRONTIER.toml: the delays, the demands that every structure meets alike, and the trials."""

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


class TrialsTable(Settings):
    """[trials]: runs of each design at the nominal vehicle, with the limits of its commands.

    ``sensor_noise_m``       standard deviation of white noise on the lateral error
    ``side_force_n``         step of the side force on a straight
    ``steering_offset_rad``  of the wheel behind its sensor, on a straight
    ``lag_s``                of the steering, which the design does not know
    ``jitter_share``         spread of the latency over its mean, which is the guaranteed delay over
                             1 + ``margin_share``
    ``seeds``                of the jitter, from 1001 on: no design has used them
    """

    sensor_noise_m: PositiveFloat = 0.02
    side_force_n: PositiveFloat = 1000.0
    steering_offset_rad: PositiveFloat = 0.02
    lag_s: PositiveFloat = 0.1
    jitter_share: Annotated[float, Field(gt=0.0, le=2.0)] = 0.3
    seeds: Annotated[int, Field(ge=1, le=100_000)] = 100


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
    trials: TrialsTable = TrialsTable()
    search: SearchTable = SearchTable()

    @model_validator(mode="after")
    def _refuse_delays_out_of_order(self) -> Self:
        if list(self.delays_ms) != sorted(set(self.delays_ms)) or self.delays_ms[0] <= 0.0:
            raise ValueError("delays_ms must be above 0 and ascend")
        return self
