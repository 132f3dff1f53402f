"""What the compiled batch is compared with, all in one process and on the same runs."""

import ctypes
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import control
import numpy as np

from ...closed_loop.compiled.engine import BatchRun, run_batch
from ...closed_loop.compiled.schedule import plan_run
from ...closed_loop.virtual_pair import run_virtual_pair
from ...controller.settings import ControllerSettings, controller_preset
from ...plant_emulator.settings import PlantSettings, plant_preset
from ..benchmarking.measurement import REPETITIONS, Line, Target
from .c_pair import CPair, CResult, compile_pair
from .other_tools import SAME_WITHIN, JitcddeLoop, python_control_loop

DURATION_S = 60.0
NETWORKS = {
    "80 ms": ("mean_s=0.08",),
    "83.7213 ms, off the grid": ("mean_s=0.0837213",),
    "80 ± 30 ms, 1 % lost": ("model=gamma", "mean_s=0.08", "spread_s=0.03", "loss=0.01"),
}

RUNS = 40
"""Runs timed together: some twenty milliseconds."""
SHORT_S = 12.0
"""Length of a run in python-control, which needs minutes for what takes us half a second."""
REPETITIONS_OF_OTHERS = 3
REPETITIONS_BESIDE_C = 21
CHART_REPETITIONS = 5
DELAY_S = 0.08


def lines_beside_c() -> list[Line]:
    """Time runs here and in C, turn by turn. Raises ValueError where their numbers differ.

    Both include the network, the law and the rig, but not the arrays of the result. The target is
    against gcc; clang, where it is installed, shows how much of the ratio is due to the compiler.
    """
    compilers = ["gcc", *(["clang"] if shutil.which("clang") else [])]
    with tempfile.TemporaryDirectory() as folder:
        libraries = {name: compile_pair(Path(folder), name) for name in compilers}
        return [
            line
            for name, network in NETWORKS.items()
            for line in _lines_of_network(name, *pair_settings(network), libraries)
        ]


def _lines_of_network(
    name: str,
    plant: PlantSettings,
    controller: ControllerSettings,
    libraries: Mapping[str, ctypes.CDLL],
) -> list[Line]:
    plan = plan_run(plant, controller)
    batch = partial(run_batch, plant, controller, plan)
    fastmath = partial(run_batch, plant, controller, plan, fastmath=True)
    in_c = {
        compiler: CPair(library, plant, controller, plan) for compiler, library in libraries.items()
    }
    for compiler, pair in in_c.items():
        _demand_same(batch(), pair.run(), f"C of {compiler} and the batch at {name}")
    fastmath()
    works: list[Callable[[], object]] = [batch, fastmath, *(pair.run for pair in in_c.values())]
    batch_us, fastmath_us, *c_us = _turn_by_turn(works)
    planning_us = _each_us(partial(plan_run, plant, controller), 5)
    rate = [1e6 / value for value in batch_us]
    lines = [Line(f"batch, {name}", "µs/run", batch_us, batch_us)]
    for compiler, theirs_us in zip(in_c, c_us, strict=True):
        wanted = Target(at_most=True, value=1.25) if compiler == "gcc" else None
        ratios = _quotients(batch_us, theirs_us)
        lines += [
            Line(f"{compiler} -O3, {name}", "µs/run", theirs_us, theirs_us),
            Line(f"batch/{compiler}, {name}", "1", ratios, batch_us, wanted),
        ]
    return [
        *lines,
        Line(f"batch, one thread, {name}", "runs/s", rate, batch_us, Target(False, 1700.0)),
        Line(f"fastmath/batch, {name}", "1", _quotients(fastmath_us, batch_us), fastmath_us),
        Line(f"network laid down, {name}", "µs", [planning_us], [planning_us]),
    ]


def _demand_same(here: BatchRun, there: CResult, who: str) -> None:
    first = len(there.lateral_error_m) - len(here.lateral_error_m)
    if not (
        np.array_equal(here.lateral_error_m, there.lateral_error_m[first:])
        and np.array_equal(here.sent_rad, there.sent_rad)
    ):
        raise ValueError(f"not the same numbers: {who}")


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
    """Time the nodes in virtual time and the loop in other tools, relative to batch runs."""
    plant, controller = pair_settings(NETWORKS["80 ms"])
    virtual, virtual_us = _ratios(
        lambda: run_virtual_pair(plant, controller, None), plant, controller
    )
    short, _ = pair_settings(NETWORKS["80 ms"], SHORT_S)
    loop, run = python_control_loop(controller, DELAY_S), run_batch(short, controller)
    path_m_s2 = -(run.motion.speed_m_s**2) * run.curvature_1_m
    control_ratios, control_us = _ratios(
        lambda: control.input_output_response(loop, run.time_s, path_m_s2), short, controller
    )
    wanted = Target(at_most=False, value=5000.0)
    return [
        Line("the nodes in virtual time / batch", "1", virtual, virtual_us),
        Line(f"python-control / batch, {SHORT_S:g} s", "1", control_ratios, control_us, wanted),
        *_lines_beside_jitcdde(plant, controller),
    ]


def _lines_beside_jitcdde(plant: PlantSettings, controller: ControllerSettings) -> list[Line]:
    """Time jitcdde against batch runs; nothing where it is not installed.

    Raises ValueError where its loop is not the same.
    """
    try:
        loop = JitcddeLoop(plant, controller, DELAY_S)
    except ImportError:
        return []
    run = run_batch(plant, controller)
    rms_m = float(np.sqrt(np.mean(loop.run(run.time_s) ** 2)))
    if abs(rms_m / run.lateral_error_rms_m - 1.0) > SAME_WITHIN:
        raise ValueError(f"jitcdde's loop has an RMS of {rms_m} m, not {run.lateral_error_rms_m}")
    ratios, each_us = _ratios(lambda: loop.run(run.time_s), plant, controller)
    wanted = Target(at_most=False, value=100.0)
    return [
        Line("jitcdde", "µs/run", each_us, each_us),
        Line("jitcdde / batch", "1", ratios, each_us, wanted),
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
    """Return the time of so many runs of a minute, and of ten runs of such lengths [s]: medians."""
    plant, controller = pair_settings(NETWORKS["80 ms"])
    plan = plan_run(plant, controller)
    by_count = [
        1e-6 * _median_us(lambda: run_batch(plant, controller, plan), count) * count
        for count in counts
    ]
    by_length = []
    for length_s in lengths_s:
        longer, _ = pair_settings(NETWORKS["80 ms"], length_s)
        its = plan_run(longer, controller)
        each_us = _median_us(partial(run_batch, longer, controller, its), 10)
        by_length.append(1e-5 * each_us)
    return {"by_count": by_count, "by_length": by_length}


def _turn_by_turn(works: Sequence[Callable[[], object]]) -> list[list[float]]:
    """Time all alternately, so that other load affects all alike; the repetitions of each [µs]."""
    times_us: list[list[float]] = [[] for _ in works]
    for _ in range(REPETITIONS_BESIDE_C):
        for times, work in zip(times_us, works, strict=True):
            times.append(_each_us(work, RUNS))
    return times_us


def _quotients(ones: Sequence[float], others: Sequence[float]) -> list[float]:
    return [one / other for one, other in zip(ones, others, strict=True)]


def _median_us(work: Callable[[], object], count: int) -> float:
    return statistics.median(_each_us(work, count) for _ in range(CHART_REPETITIONS))


def _each_us(work: Callable[[], object], count: int) -> float:
    begin_ns = time.perf_counter_ns()
    for _ in range(count):
        work()
    return (time.perf_counter_ns() - begin_ns) / 1000 / count


def pair_settings(
    network: Sequence[str], duration_s: float = DURATION_S
) -> tuple[PlantSettings, ControllerSettings]:
    """Return a run of practical_pd_ddob at 100 Hz on a network."""
    plant = plant_preset(
        "paper_corner_d",
        [f"duration_s={duration_s}", *(f"latency.downlink.{setting}" for setting in network)],
    )
    return plant, controller_preset("practical_pd_ddob")
