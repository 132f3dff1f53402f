"""Runs both nodes within the process: in virtual time, or in threads in real time."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import ExitStack
from itertools import count
from pathlib import Path

import can

from ...closed_loop.lockstep.node import LockstepNode, controller_in, controller_node
from ...closed_loop.pair.bus_recorder import BusRecorder
from ...closed_loop.pair.live_bus import Bus
from ...closed_loop.pair.virtual_bus import SharedBus, virtual_bus, with_clocks
from ...closed_loop.pair.virtual_pair import (
    START_S_MAX,
    make_virtual_plant,
    run_virtual_nodes,
    waits_in_vain,
)
from ...controller.node.node import ControllerNode
from ...controller.settings import ControllerSettings, on_bus
from ...dbc.bus_language import OUR_LANGUAGE, BusLanguage
from ...plant_emulator.faults.stage import with_faults
from ...plant_emulator.node.node import PlantNode
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.vehicle.motion_parameters import motion_params
from ...runtime.bus_model.settings import BusSettings
from ...runtime.bus_model.transmit_queue import BusOverflowError
from ...runtime.exit_status import BusError
from ...runtime.node import NEVER_NS, NS_PER_S, ReportingNode
from ...runtime.node.real_time_loop import LoopFigures, RealTimeExecutor
from ...runtime.port.python_can import BusPort
from ...runtime.program.priority_and_memory_lock import RealTimeRequest, StealClock, real_time
from ...runtime.program.report import host_report, loop_report
from ...runtime.program.run_node import FINISHED
from ...runtime.program.stop_request import StopRequest
from .result import Run

_CHANNEL_NUMBERS = count()
"""python-can's virtual channels belong to the whole process: no two runs may share one."""


def run_in_virtual_time(
    plant_settings: PlantSettings,
    controller: ControllerSettings | Sequence[str],
    settings: BusSettings,
    candump_log: Path | None,
    *,
    is_ideal: bool,
    language: BusLanguage = OUR_LANGUAGE,
) -> Run:
    """Run plant and controller on a bus with these settings.

    ``controller``  its settings, or the words of a command that speaks the lockstep protocol
    ``is_ideal``    if frames are to take no time
    ``language``    of the bus; a program speaks a car's of itself
    """
    plant, edge = make_virtual_plant(plant_settings, language=language)
    is_in_vain = waits_in_vain(plant, START_S_MAX)
    bitrate = settings.bitrate_bit_s
    bus = None if is_ideal else virtual_bus(settings, plant_settings.seed)
    stop = StopRequest()
    begin_s = time.perf_counter()
    with stop.on_signals(), controller_node(controller) as node:
        try:
            edges = edge, controller_in(language, node)
            nodes = with_clocks(*edges, settings)
            run_virtual_nodes(*nodes, bus, candump_log, lambda: stop() or is_in_vain())
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
    return Run(plant, node, edges, where, elapsed_s, ended_by, {}, shared)


def run_in_real_time(
    plant_settings: PlantSettings, controller_settings: ControllerSettings, candump_log: Path | None
) -> Run:
    """Run both nodes in threads, on python-can's bus within the process."""
    params = motion_params(
        plant_settings.vehicle,
        plant_settings.actuator,
        plant_settings.path,
        plant_settings.disturbance,
    )  # takes long, so before the first tick is due
    stop = StopRequest()
    with real_time(RealTimeRequest()) as answers, stop.on_signals():
        steal = StealClock()
        plant, edge, controller, figures = run_threaded_nodes(
            lambda start_ns: PlantNode(plant_settings, start_ns, params),
            lambda node: with_faults(node, plant_settings.faults, plant_settings.seed),
            lambda start_ns: ControllerNode(on_bus(controller_settings, takes_fd=False), start_ns),
            candump_log,
            stop,
        )
        host = host_report(answers, steal.fraction())
    loops = {name: {"loop": loop_report(loop), "host": host} for name, loop in figures.items()}
    description = "real time over python-can's interface virtual"
    elapsed_s = max(loop.duration_ns for loop in figures.values()) / NS_PER_S
    ended_by = stop.reason or FINISHED
    return Run(plant, controller, (edge, controller), description, elapsed_s, ended_by, loops)


def run_threaded_nodes(
    make_plant: Callable[[int], PlantNode],
    edge_of: Callable[[PlantNode], ReportingNode],
    make_controller: Callable[[int], ControllerNode],
    candump_log: Path | None,
    should_stop: Callable[[], bool],
) -> tuple[PlantNode, ReportingNode, ControllerNode, dict[str, LoopFigures]]:
    """Run both nodes, each in a thread and on a bus object of its own.

    ``make_plant``, ``make_controller``  called with the time of the first tick [ns]
    ``edge_of``      returns what stands between the plant and the bus
    ``candump_log``  where every frame is written, as ``candump -L`` prints it
    ``should_stop``  ends the run before the plant has finished

    Returns plant, edge and controller, and the figures of their loops, by program. Raises BusError.
    """
    with ExitStack() as stack:
        channel = f"run_{next(_CHANNEL_NUMBERS)}"
        buses = [stack.enter_context(can.Bus(interface="virtual", channel=channel)) for _ in "pc"]
        if candump_log is not None:
            stack.enter_context(BusRecorder(Bus("virtual", channel, {}), candump_log))
        start_ns = time.monotonic_ns()
        plant, controller = make_plant(start_ns), make_controller(start_ns)
        edge = edge_of(plant)
        executors = {
            "plant_emulator": RealTimeExecutor(edge, BusPort(buses[0])),
            "controller": RealTimeExecutor(controller, BusPort(buses[1])),
        }
        _run_all(list(executors.values()), should_stop)
        return plant, edge, controller, {name: run.figures for name, run in executors.items()}


def _run_all(executors: list[RealTimeExecutor], should_stop: Callable[[], bool]) -> None:
    """Run until one has ended; then end the others. Raises what an executor has raised."""
    one_has_ended = False
    with ThreadPoolExecutor(len(executors)) as pool:
        runs = [pool.submit(each.run, lambda: one_has_ended or should_stop()) for each in executors]
        wait(runs, return_when=FIRST_COMPLETED)
        one_has_ended = True
    for run in runs:
        run.result()
