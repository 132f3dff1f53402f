"""What the compiled batch is compared with, all in one process and on the same runs."""

import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import control
import numpy as np

from controller.settings import ControllerSettings
from plant_emulator.settings import PlantSettings
from tools.batch.engine import run_batch
from tools.batch.plan import plan_run
from tools.batch_benchmark.c_pair import CPair, compile_pair
from tools.batch_benchmark.python_control_loop import python_control_loop
from tools.batch_benchmark.subject import NETWORKS, pair_settings
from tools.benchmark_measurement import REPETITIONS, Line, Target
from tools.virtual_pair import run_virtual_pair

RUNS = 40
"""Runs timed together: some twenty milliseconds."""
SHORT_S = 12.0
"""Of a run that python-control simulates: half a second of ours would be minutes of its."""
REPETITIONS_OF_OTHERS = 3


def lines_beside_c() -> list[Line]:
    """Time runs here and in C, turn by turn. Raises ValueError where their numbers differ.

    In both the network, the law and the rig are there; the arrays of the result are not.
    """
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        library = compile_pair(Path(folder))
        for name, network in NETWORKS.items():
            plant, controller = pair_settings(network)
            plan = plan_run(plant, controller)
            in_c = CPair(library, plant, controller, plan)
            here, there = run_batch(plant, controller, plan), in_c.run()
            first = len(there.lateral_error_m) - len(here.lateral_error_m)
            if not (
                np.array_equal(here.lateral_error_m, there.lateral_error_m[first:])
                and np.array_equal(here.sent_rad, there.sent_rad)
            ):
                raise ValueError(f"C and the batch differ at {name}")

            batch = partial(run_batch, plant, controller, plan)
            batch_us, c_us = _turn_by_turn(batch, in_c.run)
            planning_us = _each_us(partial(plan_run, plant, controller), 5)
            lines += [
                Line(f"C -O3, {name}", "µs/run", c_us, c_us),
                Line(f"batch, {name}", "µs/run", batch_us, batch_us),
                Line(
                    f"batch/C, {name}",
                    "1",
                    [ours / theirs for ours, theirs in zip(batch_us, c_us, strict=True)],
                    batch_us,
                    Target(at_most=True, value=1.25),
                ),
                Line(f"network laid down, {name}", "µs", [planning_us], [planning_us]),
            ]
            rate = [1e6 / value for value in batch_us]
            wanted = Target(at_most=False, value=1700.0)
            lines.append(Line(f"batch, one thread, {name}", "runs/s", rate, batch_us, wanted))
    return lines


def line_of_threads() -> Line:
    """Compare two threads with one, turn by turn."""
    plant, controller = pair_settings(NETWORKS["80 ms"])
    plan = plan_run(plant, controller)

    def some_runs(count: int) -> None:
        for _ in range(count):
            run_batch(plant, controller, plan)

    def two_threads() -> None:
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(some_runs, [RUNS, RUNS]))

    ratios, work_us = [], []
    some_runs(1)
    for _ in range(REPETITIONS):
        one_us = _each_us(lambda: some_runs(2 * RUNS), 1)
        two_us = _each_us(two_threads, 1)
        ratios.append(one_us / two_us)
        work_us.append(two_us)
    return Line("two threads over one", "1", ratios, work_us, Target(at_most=False, value=1.8))


def lines_beside_others() -> list[Line]:
    """Time the nodes in virtual time, and python-control's simulation, against batch runs."""
    plant, controller = pair_settings(NETWORKS["80 ms"])
    virtual, virtual_us = _ratios(
        lambda: run_virtual_pair(plant, controller, None), plant, controller
    )
    short, _ = pair_settings(NETWORKS["80 ms"], SHORT_S)
    loop, run = python_control_loop(controller, 0.08), run_batch(short, controller)
    path_m_s2 = -(run.speed_m_s**2) * run.curvature_1_m
    control_ratios, control_us = _ratios(
        lambda: control.input_output_response(loop, run.time_s, path_m_s2), short, controller
    )
    wanted = Target(at_most=False, value=5000.0)
    return [
        Line("the nodes in virtual time / batch", "1", virtual, virtual_us),
        Line(f"python-control / batch, {SHORT_S:g} s", "1", control_ratios, control_us, wanted),
    ]


def _ratios(
    other: Callable[[], object], plant: PlantSettings, controller: ControllerSettings
) -> tuple[list[float], list[float]]:
    """Return how many times as long something takes as a batch run, and how long [µs]."""
    plan = plan_run(plant, controller)
    ratios, others = [], []
    for _ in range(REPETITIONS_OF_OTHERS):
        others.append(_each_us(other, 1))
        ratios.append(others[-1] / _each_us(partial(run_batch, plant, controller, plan), RUNS))
    return ratios, others


def seconds_of_runs(counts: Sequence[int], lengths_s: Sequence[float]) -> dict[str, list[float]]:
    """Return the time of so many runs of a minute, and of ten runs of such lengths [s]."""
    plant, controller = pair_settings(NETWORKS["80 ms"])
    plan = plan_run(plant, controller)
    by_count = [
        1e-6 * _each_us(lambda: run_batch(plant, controller, plan), count) * count
        for count in counts
    ]
    by_length = []
    for length_s in lengths_s:
        longer, _ = pair_settings(NETWORKS["80 ms"], length_s)
        its = plan_run(longer, controller)
        each_us = _each_us(partial(run_batch, longer, controller, its), 10)
        by_length.append(1e-5 * each_us)
    return {"by_count": by_count, "by_length": by_length}


def _turn_by_turn(
    one: Callable[[], object], other: Callable[[], object]
) -> tuple[list[float], list[float]]:
    """Time both alternately, so that a busy machine is busy for both [µs]."""
    ones, others = [], []
    for _ in range(REPETITIONS):
        ones.append(_each_us(one, RUNS))
        others.append(_each_us(other, RUNS))
    return ones, others


def _each_us(work: Callable[[], object], count: int) -> float:
    begin_ns = time.perf_counter_ns()
    for _ in range(count):
        work()
    return (time.perf_counter_ns() - begin_ns) / 1000 / count
