"""Settings tables `[latency.downlink]` and `[latency.uplink]`."""

from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from ...runtime.settings import Settings
from .latency_distributions import QUANTILES, Distribution, Quantile
from .latency_over_time import LATENCY_S_MAX, Profile, Shape, Trace, read_trace

LatencySeconds = Annotated[float, Field(ge=0.0, le=LATENCY_S_MAX)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]


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

    model: Distribution = Distribution.CONSTANT
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
        """The quantile function."""
        return QUANTILES[self.model]


class BothLatencySettings(Settings):
    """``[latency]``."""

    downlink: LatencySettings = LatencySettings()
    """Commands, controller to plant."""
    uplink: LatencySettings = LatencySettings()
    """Measurements, plant to controller."""
