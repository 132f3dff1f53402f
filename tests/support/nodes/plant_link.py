"""The plant node over a link that the test moves."""

import math
from collections.abc import Sequence
from typing import Any

from steer_by_wire.dbc.messages import (
    Decoded,
    DisturbanceConfig,
    LatencyConfig,
    Message,
    decode,
    encode,
)
from steer_by_wire.plant_emulator.evaluation.run_record import PlantSample
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from tests.support.frames.made_messages import command_of

MS_NS = 1_000_000
PERIOD_NS = 10 * MS_NS
START_NS = 7_000_003
NORMAL = {"model": "normal", "mean_s": 0.08, "spread_s": 0.03}


def plant_settings(**tables: Any) -> PlantSettings:
    return PlantSettings.model_validate(tables)


class Link:
    """Delivers commands as a controller would and keeps every frame that comes out."""

    def __init__(self, settings: PlantSettings, interventions: str = "allow") -> None:
        self.settings = settings.model_copy(update={"interventions": interventions})
        self.node = PlantNode(self.settings, START_NS)
        self.frames: list[tuple[int, Frame]] = []
        self.counter = 0

    def tick(self, now_ns: int) -> None:
        self.frames.extend((now_ns, frame) for frame in self.node.on_tick(now_ns))

    def tick_until(self, until_ns: int) -> None:
        """Tick at every deadline up to ``until_ns``, exactly on time."""
        while self.node.deadline_ns <= until_ns:
            self.tick(self.node.deadline_ns)

    def command(self, now_ns: int, steer_rad: float) -> None:
        """Deliver a command at ``now_ns``, after all that is due before."""
        self.tick_until(now_ns - 1)
        message = command_of(steer_rad, self.counter % 65_536)
        assert self.node.on_frame(encode(message, self.counter % 256), now_ns) == ()
        self.counter += 1

    def configure(self, now_ns: int, config: LatencyConfig | DisturbanceConfig) -> None:
        self.tick_until(now_ns - 1)
        assert self.node.on_frame(encode(config, 0), now_ns) == ()

    def messages(self, message_type: type[Message]) -> list[tuple[int, Any]]:
        """Times and contents of all messages of one type so far."""
        found = []
        for now_ns, frame in self.frames:
            decoded = decode(frame)
            if isinstance(decoded, Decoded) and isinstance(decoded.message, message_type):
                found.append((now_ns, decoded.message))
        return found

    def last(self, message_type: type[Message]) -> Any:
        return self.messages(message_type)[-1][1]


def link(**tables: Any) -> Link:
    return Link(plant_settings(**tables))


def steered(steps: int, seed: int = 1, late_ns: int = 0, **tables: Any) -> Link:
    """A run with a varying command every period, 4 ms after the sample.

    ``late_ns``  by how much every other tick is late
    """
    tested = link(seed=seed, **tables)
    for step in range(steps):
        sample_ns = START_NS + step * PERIOD_NS
        if step % 2 and late_ns:
            tested.tick_until(sample_ns - 1)
            tested.tick(sample_ns + late_ns)
        tested.command(sample_ns + 4 * MS_NS, 0.1 * math.sin(0.3 * step))
    tested.tick_until(START_NS + steps * PERIOD_NS)
    return tested


def seen(samples: Sequence[PlantSample]) -> list[tuple[float, float, float]]:
    return [(s.lateral_error_m, s.heading_error_rad, s.wheel_angle_rad) for s in samples]
