"""The emulated network: a latency line for commands, and one for measurements."""

import math
from functools import partial

from ...dbc.messages import (
    Direction,
    HandWheelFeedback,
    HandWheelState,
    LatencyChange,
    SteeringCommand,
    SteeringPlan,
)
from ...runtime.frame import Frame
from .latency_distributions import Distribution
from .latency_line import LatencyLine
from .random_streams import Stream, uniforms
from .settings import BothLatencySettings

DownlinkMessage = SteeringCommand | SteeringPlan | HandWheelState | HandWheelFeedback
"""Commands, and what the hand wheel and the controller say of the driver."""


class Network:
    """Both lines of a run; their random numbers depend on its ``seed`` only.

    ``measured_latency_s``  latency of the last measurement that left [s]
    ``traces_s``            times of the rows of each direction's trace; empty without one
    """

    def __init__(self, latency: BothLatencySettings, seed: int) -> None:
        self.downlink: LatencyLine[tuple[int, DownlinkMessage]] = LatencyLine(
            latency.downlink, partial(uniforms, seed, Stream.DOWNLINK, None)
        )
        self.uplink: LatencyLine[Frame] = LatencyLine(
            latency.uplink, partial(uniforms, seed, Stream.UPLINK, None)
        )
        self.measured_latency_s = math.nan
        self.traces_s = {
            "downlink": self.downlink.trace_times_s, "uplink": self.uplink.trace_times_s,
        }  # fmt: skip

    @property
    def lost(self) -> int:
        """Frames lost so far."""
        return self.downlink.lost + self.uplink.lost

    def measured(self, due_ns: int) -> list[Frame]:
        """Return the measurements that leave for the bus."""
        measured: list[Frame] = []
        for left_ns, came_ns, frames in self.uplink.pop_due(due_ns):
            self.measured_latency_s = (left_ns - came_ns) * 1e-9
            measured += frames
        return measured

    def reconfigure(self, config: LatencyChange) -> None:
        """Change the latency as a tool requests."""
        model = Distribution[config.model.name]
        if config.direction in (Direction.DOWNLINK, Direction.BOTH):
            self.downlink.reconfigure(model, config.mean_s, config.spread_s, config.loss)
        if config.direction in (Direction.UPLINK, Direction.BOTH):
            self.uplink.reconfigure(model, config.mean_s, config.spread_s, config.loss)
