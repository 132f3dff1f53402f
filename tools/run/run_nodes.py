"""A run of both nodes in virtual time, within the process."""

import importlib
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from ...closed_loop.lockstep.node import LockstepNode, controller_in, controller_node
from ...closed_loop.pair.virtual_bus import SharedBus, virtual_bus
from ...closed_loop.pair.virtual_pair import (
    START_S_MAX,
    make_virtual_plant,
    run_virtual_nodes,
    waits_in_vain,
)
from ...controller.node.node import ControllerNode
from ...controller.settings import ControllerSettings
from ...dbc.bus_language import OUR_LANGUAGE, BusLanguage
from ...hand_wheel.node import HandWheelNode
from ...hand_wheel.settings import HandWheelSettings
from ...hand_wheel.trace import SAMPLES_MAX as HAND_WHEEL_SAMPLES_MAX
from ...plant_emulator.settings import PlantSettings
from ...runtime.bus_model.settings import BusSettings
from ...runtime.bus_model.transmit_queue import BusOverflowError
from ...runtime.exit_status import BusError
from ...runtime.node import NEVER_NS, ReportingNode
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
    plant, edge = make_virtual_plant(plant_settings, language=language)
    is_in_vain = waits_in_vain(plant, START_S_MAX)
    wheel = None if hand_wheel is None else HandWheelNode(hand_wheel, 0, HAND_WHEEL_SAMPLES_MAX)
    others = () if wheel is None else (wheel,)
    bitrate = settings.bitrate_bit_s
    bus = None if is_ideal else virtual_bus(settings, plant_settings.seed)
    stop = StopRequest()
    begin_s = time.perf_counter()
    with stop.on_signals(), controller_node(controller) as node:
        try:
            edges = edge, controller_in(language, node)
            shown = (plant, node) if isinstance(node, ControllerNode) else (plant,)
            with _progress(shown, plant_settings.duration_s) as progress:

                def should_stop() -> bool:
                    if progress is not None:
                        progress.step()
                    return stop() or is_in_vain()

                run_virtual_nodes(*edges, bus, candump_log, should_stop, others=others)
        except BusOverflowError as error:
            raise BusError(f"{bitrate} bit/s are too few: {error}") from error
    elapsed_s = time.perf_counter() - begin_s
    carrier = "a wire that takes no time" if bus is None else f"a bus of {bitrate} bit/s"
    where, ended_by = f"virtual time over {carrier}", stop.reason or FINISHED
    if plant.motion_start_ns == NEVER_NS and not (stop.reason or edge.finished or node.finished):
        ended_by = f"{START_S_MAX} s without a command"
        if isinstance(node, LockstepNode):
            node.failure = node.failure or f"it sent no valid command in {START_S_MAX} s"
    shared = bus if isinstance(bus, SharedBus) else None
    return Run(plant, node, edges, where, elapsed_s, ended_by, shared, wheel)


def _progress(nodes: tuple[ReportingNode, ...], duration_s: float) -> AbstractContextManager[Any]:
    """Return what shows the progress; where rich is not installed, nothing does."""
    try:
        shown = importlib.import_module("steer_by_wire.tools.run.progress")
    except ImportError:
        return nullcontext()
    progress: AbstractContextManager[Any] = shown.RunProgress(nodes, duration_s)
    return progress
