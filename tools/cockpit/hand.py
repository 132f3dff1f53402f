"""The visitor's hand as a node on the bus: its angle as STEERING_COMMAND, in place of a controller.

    python -m steer_by_wire.tools.cockpit.hand FILE -i emulated -c lane1 [--wheel WHEEL.toml]

With ``--wheel`` the hand holds a hand wheel with these settings, which steers the plant.

A process of its own, which only the bus connects to the plant. The cockpit leaves the newest angle
in a file that both have mapped. A hand that the page no longer reports sends nothing: the plant
then holds, and falls back, as after the death of a controller.
"""

import argparse
import mmap
import struct
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...dbc.bus_language import add_dialect_argument, read_language
from ...dbc.messages import CAN_IDS, COMMAND_COUNTERS, Mode, Sender, SteeringCommand
from ...hand_wheel.analysis.sampled_laws import kept_of
from ...hand_wheel.node import RECEIVED, HandWheelNode
from ...hand_wheel.settings import HandWheelSettings
from ...hand_wheel.wheel import GRIPS, Grip
from ...hand_wheel.wheel_step import Hands
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_MS
from ...runtime.node.end import End
from ...runtime.node.real_time_loop import RealTimeExecutor
from ...runtime.port.interface_choice import add_bus_arguments
from ...runtime.port.port import open_port
from ...runtime.port.python_can import shutting_down
from ...runtime.program.stop_request import StopRequest
from ...runtime.settings import load_settings

PERIOD_NS = 10 * NS_PER_MS
RELEASED_NS = 500 * NS_PER_MS
"""After so long without a report of the page no one steers."""
_CONTENT = struct.Struct("=qdq")
_EMPTY = _CONTENT.pack(-RELEASED_NS, 0.0, 0)
_HANDS_LAG_S = 0.03
"""Between two reports of the page the hands move on smoothly."""


class HandFile:
    """The newest angle [rad], its time on this machine's monotonic clock [ns], and the grip."""

    def __init__(self, path: Path) -> None:
        """Map a file, and make it if there is none."""
        if not path.exists():
            path.write_bytes(_EMPTY)
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), _CONTENT.size)

    def write(self, steer_rad: float, now_ns: int, grip: str = "light") -> None:
        """Leave an angle and one of GRIPS."""
        self._map[:] = _CONTENT.pack(now_ns, steer_rad, list(GRIPS).index(grip))

    def read(self, now_ns: int) -> float | None:
        """Return the angle; None when no one steers."""
        time_ns, steer_rad, _ = _CONTENT.unpack(self._map[:])
        return steer_rad if now_ns - time_ns < RELEASED_NS else None

    @property
    def grip(self) -> Grip:
        """How the hand holds a hand wheel."""
        _, _, number = _CONTENT.unpack(self._map[:])
        return GRIPS[list(GRIPS)[int(number)]]


class Person:
    """The hand on a hand wheel: follows the newest angle of the road wheels times the ratio."""

    def __init__(self, hand: HandFile, settings: HandWheelSettings) -> None:
        self._hand, self._ratio, self._cycle_s = hand, settings.steering_ratio, settings.cycle_s
        self._kept = kept_of(1.0 / _HANDS_LAG_S, settings.cycle_s)
        self._wished_rad = 0.0

    def hands(self, now_ns: int) -> Hands | None:
        """Return what the hands do, None where they are off."""
        steer_rad = self._hand.read(now_ns)
        if steer_rad is None:
            return None
        before_rad, aim_rad = self._wished_rad, self._ratio * steer_rad
        self._wished_rad = aim_rad + self._kept * (before_rad - aim_rad)
        rate_rad_s = (self._wished_rad - before_rad) / self._cycle_s
        return Hands(self._hand.grip, before_rad, rate_rad_s, 0.0)


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
        steer_rad = self._hand.read(now_ns)
        if steer_rad is None:
            return ()
        counter, self._count = self._count % COMMAND_COUNTERS, self._count + 1
        command = SteeringCommand(steer_rad=steer_rad, command_counter=counter, mode=Mode.ACTIVE)
        return (self._commands.frame(command),)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until a signal; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--wheel", type=Path)
    add_dialect_argument(parser)
    add_bus_arguments(parser)
    options = parser.parse_args(arguments)
    stop = StopRequest()
    wheel = options.wheel and load_settings(HandWheelSettings, file=options.wheel)
    opened = open_port(options, can_ids=[CAN_IDS[kind] for kind in (RECEIVED if wheel else ())])
    with shutting_down(opened.port), stop.on_signals():
        start_ns = time.monotonic_ns()
        file = HandFile(options.file)
        hand: Any = HandNode(file, start_ns)  # no one asks it for a report
        if wheel:
            hand = HandWheelNode(wheel, start_ns, person=Person(file, wheel).hands)
        node = read_language(options.dialect).at_edge(hand, End.CONTROLLER, start_ns)
        RealTimeExecutor(node, opened.port).run(stop)
    return 0


if __name__ == "__main__":
    sys.exit(main())
