"""Plant emulator and controller in one process, in real time, on python-can's ``virtual`` bus."""

import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import ExitStack
from itertools import count
from pathlib import Path

import can

from ..controller.node.node import ControllerNode
from ..plant_emulator.faults.stage import FaultyNode
from ..plant_emulator.node.node import PlantNode
from ..runtime.node.real_time import LoopFigures, RealTimeExecutor
from ..runtime.port.python_can import BusPort

_CHANNEL_NUMBERS = count()
"""python-can's virtual channels belong to the whole process: no two runs may share one."""


def run_threaded_nodes(
    make_plant: Callable[[int], PlantNode | FaultyNode[PlantNode]],
    make_controller: Callable[[int], ControllerNode],
    candump_log: Path | None,
    should_stop: Callable[[], bool],
) -> tuple[PlantNode | FaultyNode[PlantNode], ControllerNode, dict[str, LoopFigures]]:
    """Run both nodes, each in a thread and on a bus object of its own.

    ``make_plant``, ``make_controller``  called with the time of the first tick [ns]
    ``candump_log``  where every frame is written, as ``candump -L`` prints it
    ``should_stop``  ends the run before the plant has finished

    Returns the nodes and the figures of their loops, by program. Raises BusError.
    """
    with ExitStack() as stack:
        channel = f"closed_loop_{next(_CHANNEL_NUMBERS)}"
        buses = [stack.enter_context(can.Bus(interface="virtual", channel=channel)) for _ in "pc"]
        if candump_log is not None:
            listener = stack.enter_context(can.Bus(interface="virtual", channel=channel))
            writer = can.CanutilsLogWriter(candump_log, channel=channel)
            stack.callback(can.Notifier(listener, [writer]).stop)
        start_ns = time.monotonic_ns()
        plant, controller = make_plant(start_ns), make_controller(start_ns)
        executors = {
            "plant_emulator": RealTimeExecutor(plant, BusPort(buses[0])),
            "controller": RealTimeExecutor(controller, BusPort(buses[1])),
        }
        _run_all(list(executors.values()), should_stop)
        return plant, controller, {name: run.figures for name, run in executors.items()}


def _run_all(executors: list[RealTimeExecutor], should_stop: Callable[[], bool]) -> None:
    """Run until one has ended; then end the others. Raises what an executor has raised."""
    one_has_ended = False
    with ThreadPoolExecutor(len(executors)) as pool:
        runs = [pool.submit(each.run, lambda: one_has_ended or should_stop()) for each in executors]
        wait(runs, return_when=FIRST_COMPLETED)
        one_has_ended = True
    for run in runs:
        run.result()
