"""The visitor's hand as a node on the bus: its angle as STEERING_COMMAND, in place of a controller.

    python -m steer_by_wire.tools.cockpit.hand FILE -i emulated -c lane1

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
from ...dbc.messages import COMMAND_COUNTERS, Mode, Sender, SteeringCommand
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_MS
from ...runtime.node.end import End
from ...runtime.node.real_time_loop import RealTimeExecutor
from ...runtime.port.interface_choice import add_bus_arguments
from ...runtime.port.port import open_port
from ...runtime.port.python_can import shutting_down
from ...runtime.program.stop_request import StopRequest

PERIOD_NS = 10 * NS_PER_MS
RELEASED_NS = 500 * NS_PER_MS
"""After so long without a report of the page no one steers."""
_CONTENT = struct.Struct("=qd")
_EMPTY = _CONTENT.pack(-RELEASED_NS, 0.0)


class HandFile:
    """The newest angle [rad] and its time on this machine's monotonic clock [ns]."""

    def __init__(self, path: Path) -> None:
        """Map a file, and make it if there is none."""
        if not path.exists():
            path.write_bytes(_EMPTY)
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), _CONTENT.size)

    def write(self, steer_rad: float, now_ns: int) -> None:
        """Leave an angle."""
        self._map[:] = _CONTENT.pack(now_ns, steer_rad)

    def read(self, now_ns: int) -> float | None:
        """Return the angle; None when no one steers."""
        time_ns, steer_rad = _CONTENT.unpack(self._map[:])
        return steer_rad if now_ns - time_ns < RELEASED_NS else None


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
    add_dialect_argument(parser)
    add_bus_arguments(parser)
    options = parser.parse_args(arguments)
    stop = StopRequest()
    opened = open_port(options, can_ids=())
    with shutting_down(opened.port), stop.on_signals():
        start_ns = time.monotonic_ns()
        hand: Any = HandNode(HandFile(options.file), start_ns)  # no one asks it for a report
        node = read_language(options.dialect).at_edge(hand, End.CONTROLLER, start_ns)
        RealTimeExecutor(node, opened.port).run(stop)
    return 0


if __name__ == "__main__":
    sys.exit(main())
