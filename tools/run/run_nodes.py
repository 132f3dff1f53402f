"""A run of both nodes in virtual time, within the process."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from math import ceil
from pathlib import Path

from ...closed_loop.lockstep.node import LockstepNode, controller_node
from ...closed_loop.pair.virtual_bus import virtual_bus
from ...closed_loop.pair.virtual_pair import START_S_MAX, pair_with
from ...controller.settings import ControllerSettings
from ...dbc.bus_language import OUR_LANGUAGE, BusLanguage
from ...hand_wheel.node import HandWheelNode
from ...hand_wheel.program import SAMPLES_MAX as HAND_WHEEL_SAMPLES_MAX
from ...hand_wheel.settings import HandWheelSettings
from ...plant_emulator.settings import PlantSettings
from ...runtime.bus_model.bus_model import BusOverflowError
from ...runtime.bus_model.settings import BusSettings
from ...runtime.exit_status import BusError
from ...runtime.program.run_node import FINISHED
from ...runtime.program.stop_request import StopRequest
from .result import Run


def run_in_virtual_time(
    plant_settings: PlantSettings,
    controller: ControllerSettings | Sequence[str],
    settings: BusSettings,
    candump_log: Path | None,
    *,
    is_ideal: bool,
    language: BusLanguage = OUR_LANGUAGE,
    hand_wheel: HandWheelSettings | None = None,
) -> Run:
    """Run plant and controller on a bus with these settings.

    ``controller``  its settings, or the words of a command that speaks the lockstep protocol
    ``is_ideal``    if frames are to take no time
    ``language``    of the bus; a program speaks a car's of itself
    ``hand_wheel``  None: there is none
    """
    wheel = None if hand_wheel is None else HandWheelNode(hand_wheel, 0, HAND_WHEEL_SAMPLES_MAX)
    bitrate = settings.bitrate_bit_s
    bus = virtual_bus(None if is_ideal else settings, plant_settings.seed)
    stop = StopRequest()
    begin_s = time.perf_counter()
    with stop.on_signals(), controller_node(controller) as node:
        pair = pair_with(plant_settings, node, language=language, hand_wheel=wheel)
        try:
            with _progress(plant_settings.duration_s) as on_second:

                def should_stop() -> bool:
                    on_second()
                    return stop()

                pair.run(bus, candump_log, should_stop)
        except BusOverflowError as error:
            raise BusError(f"{bitrate} bit/s are too few: {error}") from error
    elapsed_s = time.perf_counter() - begin_s
    carrier = "a wire that takes no time" if bus is None else f"a bus of {bitrate} bit/s"
    where, ended_by = f"virtual time over {carrier}", stop.reason or FINISHED
    if not (pair.has_started or stop.reason or pair.edge.finished or node.finished):
        ended_by = f"{START_S_MAX} s without a command"
        if isinstance(node, LockstepNode):
            node.failure = node.failure or f"it sent no valid command in {START_S_MAX} s"
    shared = bus if bus is not None and bus.is_lossy else None
    edges = pair.edge, pair.controller_edge
    return Run(pair.plant, node, edges, where, elapsed_s, ended_by, shared, wheel)


@contextmanager
def _progress(duration_s: float) -> Iterator[Callable[[], None]]:
    """Show a bar of the seconds, which are reported one by one; without rich there is none."""
    try:
        from rich.console import Console

        from ...closed_loop.reports.terminal import counting_bars
    except ImportError:
        yield lambda: None
        return
    with counting_bars(Console(stderr=True)) as bars:
        yield partial(bars.advance, bars.add_task("", total=ceil(duration_s)))
