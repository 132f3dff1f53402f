"""What a page may ask for, checked: JSON in, a record out, one line for a mistake."""

from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from ...dbc.messages import Direction, DisturbanceConfig, LatencyConfig
from ...runtime.settings import Settings
from .rig import Action, Program
from .scenario import LANES_MAX, Latency


class SetLatency(Settings):
    """Change the latency of one direction, or of both, in every lane."""

    do: Literal["latency"]
    direction: Literal["downlink", "uplink", "both"]
    latency: Latency

    @property
    def message(self) -> LatencyConfig:
        """What is sent for it."""
        latency = self.latency
        return LatencyConfig(
            Direction[self.direction.upper()],
            latency.wire_model,
            latency.mean_s,
            latency.spread_s,
            latency.loss,
        )


class Disturb(Settings):
    """Let these disturbances act from now on, in every lane."""

    do: Literal["disturb"]
    side_force_n: Annotated[float, Field(ge=-32767.0, le=32767.0)]
    steering_offset_rad: Annotated[float, Field(ge=-0.5, le=0.5)]
    friction: Annotated[float, Field(ge=0.05, le=1.0)]

    @property
    def message(self) -> DisturbanceConfig:
        """What is sent for it."""
        return DisturbanceConfig(
            self.side_force_n, 0.0, self.steering_offset_rad, 1.0 - self.friction
        )


class Start(Settings):
    """Start a scenario anew; ``scenario`` is checked where it is used."""

    do: Literal["start"]
    scenario: dict[str, Any]


class Act(Settings):
    """Kill, pause, resume or restart one process."""

    do: Literal["process"]
    lane: Annotated[int, Field(ge=0, lt=LANES_MAX)]
    program: Program
    action: Action


class Record(Settings):
    """Begin or end a recording of every lane."""

    do: Literal["record"]
    on: bool


class ResetFigures(Settings):
    """Let the running figures start anew."""

    do: Literal["reset"]


Wish = Annotated[
    SetLatency | Disturb | Start | Act | Record | ResetFigures, Field(discriminator="do")
]
_WISH: TypeAdapter[Wish] = TypeAdapter(Wish)


class WishError(ValueError):
    """A wish that cannot be fulfilled; the text is one line for the page."""


def wish_of(text: str) -> Wish:
    """Return the wish in a message of a page; raises WishError."""
    try:
        return _WISH.validate_json(text, strict=True)
    except ValidationError as error:
        mistake = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(map(str, mistake["loc"]))
        raise WishError(f"{where or 'message'}: {mistake['msg']}") from error
