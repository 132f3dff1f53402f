"""The controller node over a link that the test steps, with a stand-in for the plant."""

from collections.abc import Sequence
from typing import Any

from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.messages import Decoded, Message, SteeringCommand, decode, encode
from steer_by_wire.runtime.frame import Frame
from tests.support.frames.made_messages import error_of

MS_NS = 1_000_000
PERIOD_NS = 10 * MS_NS
START_NS = 7 * MS_NS
PD = {
    "proportional_gain_rad_m": 1.0,
    "derivative_gain_rad_s_m": 0.9,
    "derivative_filter_rad_s": 5.0,
}
SUPERVISION = {
    "measurement_timeout_ms": 50.0,
    "hold_ms": 100.0,
    "ramp_rad_s": 1.0,
    "recovery_frames": 3,
}


def controller_settings(**tables: Any) -> ControllerSettings:
    return ControllerSettings.model_validate(
        {"law": "pd", "pd": PD, "supervision": SUPERVISION, **tables}
    )


class Link:
    """Carries frames at once and keeps the typed messages that came out, with their times."""

    def __init__(self, node: ControllerNode) -> None:
        self.node = node
        self.sent: list[tuple[int, Message, int]] = []
        self.counters: dict[type[Message], int] = {}
        self.now_ns = START_NS

    def deliver(self, message: Message, skip: int = 0) -> None:
        """Hand a message over as its sender would, after ``skip`` frames that got lost."""
        counter = self.counters.get(type(message), 0) + skip
        self.counters[type(message)] = counter + 1
        assert self.node.on_frame(encode(message, counter % 256), self.now_ns) == ()

    def tick_until(self, until_ns: int) -> None:
        """Tick at every deadline before ``until_ns``, exactly on time."""
        while self.node.deadline_ns < until_ns:
            self.now_ns = self.node.deadline_ns
            self.keep(self.node.on_tick(self.now_ns))
        self.now_ns = until_ns

    def keep(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            decoded = decode(frame)
            assert isinstance(decoded, Decoded)
            self.sent.append((self.now_ns, decoded.message, decoded.counter))

    def drive(self, periods: int, lateral_error_m: float | None) -> None:
        """Pass some periods, with a measurement just before each tick, or without any."""
        for _ in range(periods):
            if lateral_error_m is not None:
                self.deliver(error_of(lateral_error_m))
            self.tick_until(self.now_ns + PERIOD_NS)

    @property
    def commands(self) -> list[SteeringCommand]:
        return [message for _, message, _ in self.sent if isinstance(message, SteeringCommand)]
