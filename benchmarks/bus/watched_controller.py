"""The controller program, which records when each tick ran, and may also tick on a measurement.

    python -m benchmarks.bus.watched_controller --answer WHEN --ticks FILE ...

Node, port, executor and requests to the host are the program's own, and so are all other options.
WHEN is one of

    at-rate   the program as it is
    fed       the same, with a measurement of its own before each tick: for a bus without plant
    at-once   does the whole tick when a measurement arrives instead of when it is due, so that
              the work is timed, and not the wait for the period

FILE holds two int64 a tick, its deadline and when it ran [ns, monotonic clock].
"""

import argparse
import gc
import sys
from array import array
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from steer_by_wire.controller.node.node import RECEIVED, ControllerNode
from steer_by_wire.controller.settings import PRESETS, ControllerSettings
from steer_by_wire.dbc.messages import CAN_IDS, LateralError
from steer_by_wire.runtime.command_line import output_file, run_main
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NEVER_NS, Wrapper
from steer_by_wire.runtime.program.node_options import load_program_settings, make_parser
from steer_by_wire.runtime.program.run_node import Edge, run_node
from steer_by_wire.tools.doctor.wake_ups import measurements

NAME = "watched-controller"
WARM_UP_TICKS = 100
"""By this tick all caches and all bins of the statistics that a quiet run needs exist."""
_MEASUREMENT_ID = CAN_IDS[LateralError]


class Watch:
    """Counts what the interpreter does from the tick ``WARM_UP_TICKS`` to the last one."""

    def __init__(self) -> None:
        self._ticks = 0
        self._blocks_before = 0
        self._seen = 0  # collections of garbage, also those after the run, when it is on again
        self._seen_before = 0
        self._seen_at_last_tick = 0
        gc.callbacks.append(self._on_collection)

    def tick(self) -> None:
        """Count a tick."""
        self._ticks += 1
        self._seen_at_last_tick = self._seen
        if self._ticks == WARM_UP_TICKS:
            self._seen_before = self._seen
            self._blocks_before = sys.getallocatedblocks()

    def report(self) -> Mapping[str, Any]:
        """Stop watching; returns collections, and blocks of memory taken and kept, each tick."""
        ticks = self._ticks - WARM_UP_TICKS
        kept = sys.getallocatedblocks() - self._blocks_before
        gc.callbacks.remove(self._on_collection)
        return {
            "ticks_watched": max(ticks, 0),
            "collections": self._seen_at_last_tick - self._seen_before if ticks > 0 else 0,
            "blocks_kept_per_tick": kept / ticks if ticks > 0 else None,
        }

    def _on_collection(self, phase: str, _info: Mapping[str, int]) -> None:
        self._seen += phase == "start"


class Watched(Wrapper[ControllerNode]):
    """``node``, watched; ``ticks`` holds the deadline of each tick and when it ran [ns]."""

    def __init__(self, node: ControllerNode) -> None:
        super().__init__(node)
        self._watch = Watch()
        self.ticks = array("q")

    def report(self) -> Mapping[str, Any]:
        """Return what the node and the watch have to report."""
        return {**self.node.report(), **self._watch.report()}


class AtRate(Watched):
    """``node`` as it is; ``feed`` are measurements that it is handed in turn, one a tick."""

    def __init__(self, node: ControllerNode, feed: Sequence[Frame] = ()) -> None:
        super().__init__(node)
        self._feed = feed

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Tick, and keep when."""
        self._watch.tick()
        self.ticks.append(self.node.deadline_ns)
        self.ticks.append(now_ns)
        if self._feed:
            self.node.on_frame(self._feed[len(self.ticks) // 2 % len(self._feed)], now_ns)
        return self.node.on_tick(now_ns)


class AtOnce(Watched):
    """``node``, whose time advances by one period with each measurement."""

    @property
    def deadline_ns(self) -> int:
        """Never: only a measurement causes a tick."""
        return NEVER_NS

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Process a frame; returns the command that a measurement leads to."""
        due_ns = self.node.deadline_ns
        self.node.on_frame(frame, due_ns)
        if frame.can_id != _MEASUREMENT_ID:
            return ()
        self._watch.tick()
        self.ticks.append(now_ns)
        self.ticks.append(now_ns)
        return self.node.on_tick(due_ns)

    def on_tick(self, _now_ns: int) -> Sequence[Frame]:
        """Is never due."""
        return ()


ANSWERS: dict[str, Callable[[ControllerNode], Watched]] = {
    "at-rate": AtRate,
    "fed": lambda node: AtRate(node, measurements()),
    "at-once": AtOnce,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = make_parser(
        NAME, "The controller program, watched.", NAME, PRESETS, ControllerSettings
    )
    parser.add_argument("--answer", choices=tuple(ANSWERS), default="at-rate")
    parser.add_argument("--ticks", type=output_file, metavar="FILE", help="when each tick ran")
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    settings = load_program_settings(ControllerSettings, PRESETS, options)
    nodes = list[Watched]()

    def make_node(start_ns: int) -> Watched:
        nodes.append(ANSWERS[options.answer](ControllerNode(settings, start_ns)))
        return nodes[0]

    edge = Edge([CAN_IDS[message_type] for message_type in RECEIVED])
    return run_node(
        NAME, options, settings, make_node, lambda _: _write_ticks(options.ticks, nodes[0]), edge
    )


def _write_ticks(path: Path | None, node: Watched) -> None:
    if path is not None:
        path.write_bytes(node.ticks.tobytes())


if __name__ == "__main__":
    sys.exit(main())
