"""The visitor's hand as a node on the bus: its angle as STEERING_COMMAND, in place of a controller.

    python -m steer_by_wire.tools.cockpit.hand FILE -i emulated -c lane1 [--wheel WHEEL.toml]

With ``--wheel`` the hand holds a hand wheel with these settings, which steers the plant; with
``--usb-wheel`` too, a real one. With ``--pedals`` it asks for the speed too.

A process of its own, which only the bus connects to the plant. The cockpit leaves the newest orders
in a file that both have mapped. A hand that the page no longer reports sends nothing, and asks for
speed 0: the plant then holds, and falls back, as after the death of a controller.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...dbc.bus_language import add_dialect_argument, read_language
from ...dbc.messages import (
    CAN_IDS,
    COMMAND_COUNTERS,
    Mode,
    Sender,
    SpeedRequest,
    SteeringCommand,
    limits,
)
from ...hand_wheel.node import RECEIVED, HandWheelNode
from ...hand_wheel.settings import HandWheelSettings
from ...hand_wheel.wheel import GRIPS, kept_of
from ...hand_wheel.wheel_step import Hands
from ...runtime.frame import Frame
from ...runtime.node import NEVER_NS, NS_PER_MS, Wrapper
from ...runtime.node.end import End
from ...runtime.node.periodic import PeriodicTimer
from ...runtime.node.real_time_loop import RealTimeExecutor
from ...runtime.port.interface_choice import add_bus_arguments
from ...runtime.port.port import open_port
from ...runtime.port.python_can import shutting_down
from ...runtime.program.stop_request import StopRequest
from ...runtime.settings import load_settings
from .orders import HAND_WHEELS, HANDS_OFF, HandFile, Orders, UsbWheel

PERIOD_NS = 10 * NS_PER_MS
SPEED_M_S_MAX = limits(SpeedRequest)["speed_max_m_s"].maximum
_SPEED_PERIOD_NS = 100 * NS_PER_MS


class Person:
    """The hand on a hand wheel: follows the newest angle of the road wheels times the ratio."""

    def __init__(self, hand: HandFile, settings: HandWheelSettings) -> None:
        self._hand, self._ratio, self._cycle_s = hand, settings.steering_ratio, settings.cycle_s
        self._kept = kept_of(1.0 / hand.lag_s, settings.cycle_s)
        self._wished_rad = 0.0

    def hands(self, now_ns: int) -> Hands | None:
        """Return what the hands do, None where they are off."""
        orders = self._hand.read(now_ns)
        if orders is None or orders.grip == HANDS_OFF:
            return None
        before_rad, aim_rad = self._wished_rad, self._ratio * orders.steer_rad
        self._wished_rad = aim_rad + self._kept * (before_rad - aim_rad)
        rate_rad_s = (self._wished_rad - before_rad) / self._cycle_s
        return Hands(GRIPS[orders.grip], before_rad, rate_rad_s, 0.0)


class HandNode:
    """Sends a command every 10 ms while somebody steers; reads nothing from the bus."""

    finished = False

    def __init__(self, hand: HandFile, start_ns: int) -> None:
        self._hand = hand
        self._commands = Sender(SteeringCommand)
        self._count = 0
        self.deadline_ns = start_ns

    def on_frame(self, _frame: Frame, _now_ns: int) -> Sequence[Frame]:
        """Take note of nothing."""
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Return the command that is due; ticks that were missed are left out."""
        self.deadline_ns += ((now_ns - self.deadline_ns) // PERIOD_NS + 1) * PERIOD_NS
        orders = self._hand.read(now_ns)
        if orders is None:
            return ()
        counter, self._count = self._count % COMMAND_COUNTERS, self._count + 1
        command = SteeringCommand(
            steer_rad=orders.steer_rad, command_counter=counter, mode=Mode.ACTIVE
        )
        return (self._commands.frame(command),)


class Seat(Wrapper[Any]):
    """The hand with the visitor's other orders: the speed of the car, and the feedback law.

    ``node``    HandNode, which has no feedback law, or HandWheelNode
    ``pedals``  whether to send SPEED_REQUEST, before all else: the car is to wait for it
    """

    def __init__(self, node: Any, hand: HandFile, start_ns: int, *, pedals: bool) -> None:
        super().__init__(node)
        self._hand, self._wheel = hand, ""
        self._speeds = PeriodicTimer(start_ns if pedals else NEVER_NS, _SPEED_PERIOD_NS)
        self._requests = Sender(SpeedRequest)

    @property
    def deadline_ns(self) -> int:
        """When the next frame is due."""
        return min(int(self.node.deadline_ns), self._speeds.deadline_ns)

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Send what is due."""
        orders = self._hand.read(now_ns) or Orders()
        if orders.wheel not in ("", self._wheel) and isinstance(self.node, HandWheelNode):
            self._wheel = orders.wheel
            self.node.feel(HAND_WHEELS[orders.wheel])
        frames: list[Frame] = []
        if self._speeds.deadline_ns <= now_ns:
            self._speeds.advance(now_ns)
            frames.append(self._requests.frame(SpeedRequest(speed_max_m_s=orders.speed_m_s)))
        if self.node.deadline_ns <= now_ns:
            frames += self.node.on_tick(now_ns)
            if isinstance(self.node, HandWheelNode):
                self._hand.play(-self.node.driver_torque_n_m, now_ns)
        return frames


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until a signal; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--wheel", type=Path)
    parser.add_argument("--usb-wheel", type=Path)
    parser.add_argument("--pedals", action="store_true")
    add_dialect_argument(parser)
    add_bus_arguments(parser)
    options = parser.parse_args(arguments)
    stop = StopRequest()
    wheel = options.wheel and load_settings(HandWheelSettings, file=options.wheel)
    opened = open_port(options, can_ids=[CAN_IDS[kind] for kind in (RECEIVED if wheel else ())])
    with shutting_down(opened.port), stop.on_signals():
        start_ns = time.monotonic_ns()
        if wheel and options.usb_wheel:
            file: HandFile = UsbWheel(options.file, options.usb_wheel, wheel.steering_ratio)
        else:
            file = HandFile(options.file)
        hand: Any = HandNode(file, start_ns)  # no one asks it for a report
        if wheel:
            hand = HandWheelNode(wheel, start_ns, person=Person(file, wheel).hands)
        hand = Seat(hand, file, start_ns, pedals=options.pedals)
        node = read_language(options.dialect).at_edge(hand, End.CONTROLLER, start_ns)
        RealTimeExecutor(node, opened.port).run(stop)
    return 0


if __name__ == "__main__":
    sys.exit(main())
