"""Settings tables `[latency.downlink]` and `[latency.uplink]`.

Another package may provide the distribution (``LatencyModel``); see ``runtime.settings.plugin``.
"""

from collections.abc import Callable
from enum import StrEnum
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator
from pydantic_core import PydanticKnownError

from ...runtime.settings import Settings
from ...runtime.settings.plugin import (
    PLUGIN_TABLE,
    TABLE_SCHEMA,
    PartError,
    PluginTable,
    call_part,
    find_part,
    plugin_table,
)
from .latency_distributions import QUANTILES, Distribution, Quantile
from .latency_over_time import LATENCY_S_MAX, Profile, Shape, Trace, read_trace

LatencySeconds = Annotated[float, Field(ge=0.0, le=LATENCY_S_MAX)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
_TRIED = (0.001, 0.5, 0.999)
"""Uniforms with which a latency model of another package is tested."""


class LatencyModel(NamedTuple):
    """Latency of frames: ``quantile(u, mean_s, spread_s, own) -> latency_s``.

    ``u`` is uniform in (0, 1); the latency must not decrease with u, and be 0 to 10 s.
    """

    quantile: Callable[[float, float, float, Any], float]
    settings: type[Settings] | None = None


find_latency_model = partial(find_part, kind=LatencyModel, noun="latency model")
"""Returns the model at a place; raises ValueError."""


def plugin_quantile(place: str, own: Settings | None) -> Callable[[float, float, float], float]:
    """Return the quantile function of a latency model; it raises PartError."""
    model, what = find_latency_model(place), f"latency model {place}"

    def quantile(u: float, mean_s: float, spread_s: float) -> float:
        latency_s = call_part(what, model.quantile, u, mean_s, spread_s, own)
        if not (isinstance(latency_s, float | int) and 0.0 <= latency_s <= LATENCY_S_MAX):
            raise PartError(
                f"{what} gives {latency_s!r} s at u = {u:g}, mean_s = {mean_s:g}, spread_s ="
                f" {spread_s:g} (allowed: number from 0, up to {LATENCY_S_MAX:g})"
            )
        return latency_s

    return quantile


def _known_model(name: Any) -> Distribution | str:
    if isinstance(name, str) and ":" in name:
        find_latency_model(name)
        return name
    known = [*Distribution]
    if name not in known:
        raise PydanticKnownError("enum", {"expected": ", ".join(known)})
    return Distribution(name)


LatencyModelName = Annotated[
    Distribution | str,
    PlainValidator(_known_model),
    WithJsonSchema({"enum": [*Distribution], "type": "string"}),
]
"""One of ours, or ``package.module:ATTRIBUTE`` of a ``LatencyModel``."""


class Order(StrEnum):
    """What happens when a frame overtakes an earlier one of the same message."""

    NEWEST_WINS = "newest_wins"
    """The earlier frame is dropped on arrival, as by a receiver that ignores old data."""
    IN_ORDER = "in_order"
    """It waits behind the earlier one, as in a gateway's queue."""
    AS_ARRIVES = "as_arrives"
    """The earlier frame arrives after it, as in a network with several routes."""


class SchedulePoint(Settings):
    """One ``[[latency.*.schedule]]``: latency from ``time_s`` of motion on."""

    time_s: float = Field(ge=0.0, le=1e9)
    mean_s: LatencySeconds
    spread_s: LatencySeconds = 0.0
    loss: Probability = 0.0


class LatencySettings(Settings):
    """The network in one direction; by default it changes nothing."""

    model: LatencyModelName = Distribution.CONSTANT
    own: Annotated[PluginTable, plugin_table(find_latency_model), TABLE_SCHEMA] = PLUGIN_TABLE
    mean_s: LatencySeconds = 0.0
    spread_s: LatencySeconds = 0.0
    """Standard deviation."""
    correlation_time_s: float = Field(0.0, ge=0.0, le=1e6)
    """Of the AR(1) process behind the latencies; 0: frames are independent."""
    loss: Probability = 0.0
    """Long-run share of lost frames."""
    burst_frames: float | None = Field(None, ge=1.0, le=1e6)
    """Mean length of a burst of loss; default: independent losses."""
    order: Order = Order.NEWEST_WINS
    schedule: tuple[SchedulePoint, ...] = Field((), max_length=100_000)
    """Replaces mean_s, spread_s and loss."""
    schedule_shape: Shape = Shape.STEP
    trace_file: Path | None = None
    """Recorded latencies (CSV: latency_s, or time_s,latency_s; lost where empty or ``lost``);
    replaces the model."""
    latencies_s: tuple[LatencySeconds, ...] = Field((), max_length=1_000_000)
    """Latencies of one sample after the other; after the last the first again."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.model is Distribution.CONSTANT and self.spread_s > 0.0:
            raise ValueError("spread_s needs a model other than 'constant'")
        for earlier, later in pairwise(self.schedule):
            if later.time_s < earlier.time_s:
                raise ValueError(
                    f"schedule must rise in time: {later.time_s} s follows {earlier.time_s} s"
                )
        given = {
            "schedule": self.schedule,
            "trace_file": self.trace_file,
            "latencies_s": self.latencies_s,
        }
        if len(several := [name for name, value in given.items() if value]) > 1:
            raise ValueError(f"{' and '.join(several)} exclude each other")
        self.trace()  # raises SettingsError, a ValueError
        if not isinstance(self.model, Distribution):
            for u in _TRIED:
                self.quantile(u, self.mean_s, self.spread_s)
        return self

    @property
    def has_trace(self) -> bool:
        """Whether the latencies are given one by one."""
        return self.trace_file is not None or bool(self.latencies_s)

    def trace(self) -> Trace | None:
        """Return the latencies that are given one by one, if any; raises SettingsError."""
        if self.trace_file is not None:
            return read_trace(self.trace_file)
        return Trace(self.latencies_s) if self.latencies_s else None

    @property
    def profile(self) -> Profile:
        """The points of the schedule."""
        return [(point.time_s, point.mean_s, point.spread_s, point.loss) for point in self.schedule]

    @property
    def quantile(self) -> Quantile:
        """The quantile function; one of another package raises PartError when it fails."""
        if isinstance(self.model, Distribution):
            return QUANTILES[self.model]
        return plugin_quantile(self.model, self.own)


class BothLatencySettings(Settings):
    """``[latency]``."""

    downlink: LatencySettings = LatencySettings()
    """Commands, controller to plant."""
    uplink: LatencySettings = LatencySettings()
    """Measurements, plant to controller."""
