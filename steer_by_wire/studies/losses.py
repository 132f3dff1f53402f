"""Frames that the network loses in a run, by direction; overtaken frames are not counted.

The latency lines draw losses from a stream of their own, independent of the latencies. So the
frames that come through a line with the same losses and no latency are those that are not lost.
"""

from typing import NamedTuple

import numpy as np

from ..compiled.network import Frames, passages
from ..compiled.plan import Plan
from ..plant_emulator.latency import Distribution
from ..plant_emulator.latency_settings import LatencySettings, Order
from ..plant_emulator.sampling import samples_per_vehicle_state
from ..plant_emulator.settings import PlantSettings
from ..plant_emulator.streams import Channel
from ..runtime.array_types import BoolArray, IntArray


class Losses(NamedTuple):
    """Cumulative numbers of lost frames; None where no frame can be lost.

    ``down``  shape (ticks,), after each tick
    ``up``    shape (samples,), after each sample: of all messages
    """

    down: IntArray | None
    up: IntArray | None

    def commands(self, ticks: int) -> int:
        """Return how many of the first commands are lost."""
        return 0 if self.down is None or ticks == 0 else int(self.down[ticks - 1])

    def measurements(self, samples: int) -> int:
        """Return how many frames of the first samples are lost."""
        return 0 if self.up is None or samples == 0 else int(self.up[samples - 1])


def losses_of(plant: PlantSettings, plan: Plan) -> Losses:
    """Return what is lost in a run."""
    latency = plant.latency
    down: IntArray | None = None
    up: IntArray | None = None
    if _may_lose(latency.downlink):
        lost = _lost(latency.downlink, plant.seed, Channel.DOWNLINK, plan.tick_ns, plan)
        down = np.cumsum(lost)
    if _may_lose(latency.uplink):
        messages = np.full(len(plan.sample_ns), 2)
        messages[:: samples_per_vehicle_state(plant.sensor_period_ns)] = 3
        came_ns = np.repeat(plan.sample_ns, messages)
        lost = _lost(latency.uplink, plant.seed, Channel.UPLINK, came_ns, plan)
        up = np.cumsum(lost)[np.cumsum(messages) - 1]
    return Losses(down, up)


def _may_lose(line: LatencySettings) -> bool:
    return line.loss > 0.0 or line.burst_frames is not None or any(p.loss for p in line.schedule)


def _lost(
    line: LatencySettings, seed: int, channel: Channel, came_ns: IntArray, plan: Plan
) -> BoolArray:
    bare = line.model_copy(
        update={
            "model": Distribution.CONSTANT,
            "mean_s": 0.0,
            "spread_s": 0.0,
            "correlation_time_s": 0.0,
            "duplicates": 0.0,
            "order": Order.AS_ARRIVES,
            "trace_file": None,
            "schedule": tuple(
                point.model_copy(update={"mean_s": 0.0, "spread_s": 0.0}) for point in line.schedule
            ),
        }
    )
    frames = Frames(
        came_ns,
        np.maximum(came_ns - plan.motion_start_ns, 0),
        np.ones(len(came_ns), dtype=np.bool_),
    )
    lost = np.ones(len(came_ns), dtype=np.bool_)
    lost[passages(bare, seed, channel, channel, frames).frame] = False
    return lost
