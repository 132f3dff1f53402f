"""Memory that the interpreter allocates in a tick of the controller, without a bus.

In a live run the garbage collector is off (``runtime.program.priority_and_memory_lock``). Here it
is left on with Python's usual thresholds, and its collections are counted.
"""

import gc
import tracemalloc
from collections.abc import Mapping
from statistics import median
from typing import NamedTuple

from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.tools.doctor.wake_ups import measurements

WARM_UP_TICKS = 300


class TickMemory(NamedTuple):
    """Figures of a tick with one measurement before it.

    ``collections_if_on``  that the collector would make, left on with its usual thresholds, in all
    ``bytes_at_peak``      taken during a tick beyond what was held before it, the median
    ``bytes_kept``         of them after it, on average
    """

    ticks: int
    collections_if_on: int
    bytes_at_peak: float
    bytes_kept: float


def tick_memory(preset: str, ticks: int) -> TickMemory:
    """Let a controller tick ``ticks`` times, twice: for the collections and for the bytes."""
    settings = controller_preset(preset)
    return TickMemory(ticks, _collections(settings, ticks), *_bytes(settings, ticks))


def _collections(settings: ControllerSettings, ticks: int) -> int:
    collections = 0

    def on_collection(phase: str, _info: Mapping[str, int]) -> None:
        nonlocal collections
        collections += phase == "start"

    loop = _Loop(settings)
    was_enabled = gc.isenabled()
    gc.collect()
    gc.enable()
    gc.callbacks.append(on_collection)
    try:
        for _ in range(ticks):
            loop.tick()
    finally:
        gc.callbacks.remove(on_collection)
        if not was_enabled:
            gc.disable()
    return collections


def _bytes(settings: ControllerSettings, ticks: int) -> tuple[float, float]:
    loop, peaks = _Loop(settings), [0] * ticks
    tracemalloc.start()
    try:
        begin, _ = tracemalloc.get_traced_memory()
        for index in range(ticks):
            before, _ = tracemalloc.get_traced_memory()
            tracemalloc.reset_peak()
            loop.tick()
            peaks[index] = tracemalloc.get_traced_memory()[1] - before
        end, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return median(peaks), (end - begin) / ticks


class _Loop:
    """A controller that receives measurements, after its first ticks."""

    def __init__(self, settings: ControllerSettings) -> None:
        self._node = ControllerNode(settings, 0)
        self._frames = measurements()
        self._ticks = 0
        for _ in range(WARM_UP_TICKS):
            self.tick()

    def tick(self) -> None:
        now_ns = self._node.deadline_ns
        self._node.on_frame(self._frames[self._ticks % len(self._frames)], now_ns)
        self._node.on_tick(now_ns)
        self._ticks += 1
