"""Times compiled runs, on one thread and on two, and a cold start."""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from matplotlib.figure import Figure

from benchmarks.measurement import REPETITIONS, Line, Measured, Target
from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.compiled.schedule import schedule_run
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.command_line import output_file

DURATION_S = 60.0
NETWORKS = {
    "80 ms": ("mean_s=0.08",),
    "83.7213 ms, off the grid": ("mean_s=0.0837213",),
    "80 ± 30 ms, 1 % lost": ("model=gamma", "mean_s=0.08", "spread_s=0.03", "loss=0.01"),
}

RUNS = 40
"""Runs timed together: some twenty milliseconds."""
CHART_REPETITIONS = 5
COUNTS = (10, 30, 100, 300, 1000)
LENGTHS_S = (10.0, 30.0, 100.0, 300.0, 1000.0)
STARTS = 5
_FIRST_RESULT = """
from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.settings import plant_preset
run_compiled(plant_preset("paper_corner_d"), controller_preset("practical_pd_ddob"))
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument(
        "--chart",
        type=output_file,
        metavar="FILE.png",
        help="plot of the time over the number and the length of runs",
    )


def measure(options: argparse.Namespace) -> Measured:
    """Time compiled runs, threads and starts."""
    lines = [line for name in NETWORKS for line in lines_of_network(name)]
    lines += [line_of_virtual_time(), line_of_threads(), *start_lines()]
    seconds = seconds_of_runs(COUNTS, LENGTHS_S)
    if options.chart is not None:
        draw_chart(seconds).savefig(options.chart, dpi=100)
    return Measured(lines, record={"runs": COUNTS, "lengths_s": LENGTHS_S, **seconds})


def lines_of_network(name: str) -> list[Line]:
    """Time runs on a network."""
    plant, controller = pair_settings(NETWORKS[name])
    plan = schedule_run(plant, controller)
    batch = partial(run_compiled, plant, controller, plan)
    batch()
    batch_us = [_each_us(batch, RUNS) for _ in range(REPETITIONS)]
    rates = [1e6 / each_us for each_us in batch_us]
    planning_us = [_each_us(partial(schedule_run, plant, controller), 5)]
    return [
        Line(f"batch, {name}", "µs/run", batch_us, batch_us),
        Line(f"batch, one thread, {name}", "runs/s", rates, batch_us, Target(False, 1700.0)),
        Line(f"network laid down, {name}", "µs", planning_us, planning_us),
    ]


def line_of_virtual_time() -> Line:
    """Compare the nodes in virtual time with compiled runs."""
    plant, controller = pair_settings(NETWORKS["80 ms"])
    batch = partial(run_compiled, plant, controller, schedule_run(plant, controller))
    nodes_us = _each_us(partial(run_virtual_pair, plant, controller, None), 1)
    ratio = nodes_us / _each_us(batch, RUNS)
    return Line("the nodes in virtual time / batch", "1", [ratio], [nodes_us])


def line_of_threads() -> Line:
    """Compare two threads with one, turn by turn."""
    plant, controller = pair_settings(NETWORKS["80 ms"])
    plan = schedule_run(plant, controller)

    def some_runs(count: int) -> None:
        for _ in range(count):
            run_compiled(plant, controller, plan)

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


def seconds_of_runs(counts: Sequence[int], lengths_s: Sequence[float]) -> dict[str, list[float]]:
    """Return the time of so many runs of a minute, and of ten runs of such lengths [s]: medians."""
    plant, controller = pair_settings(NETWORKS["80 ms"])
    plan = schedule_run(plant, controller)
    by_count = [
        1e-6 * _median_us(lambda: run_compiled(plant, controller, plan), count) * count
        for count in counts
    ]
    by_length = []
    for length_s in lengths_s:
        longer, _ = pair_settings(NETWORKS["80 ms"], length_s)
        its = schedule_run(longer, controller)
        each_us = _median_us(partial(run_compiled, longer, controller, its), 10)
        by_length.append(1e-5 * each_us)
    return {"by_count": by_count, "by_length": by_length}


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


def start_lines() -> list[Line]:
    """Time a new process up to its first result, without and with a cache on disk."""
    cold, warm = [], []
    for _ in range(STARTS):
        with tempfile.TemporaryDirectory() as cache:
            cold.append(_first_result_s(cache))
            warm.append(_first_result_s(cache))
    return [
        Line("import to first result, cold", "s", cold, [1e6 * s for s in cold], Target(True, 5.0)),
        Line("import to first result, warm", "s", warm, [1e6 * s for s in warm], Target(True, 1.5)),
    ]


def _first_result_s(cache: str) -> float:
    begin_s = time.perf_counter()
    environment = {**os.environ, "XDG_CACHE_HOME": cache}
    subprocess.run((sys.executable, "-P", "-c", _FIRST_RESULT), check=True, env=environment)
    return time.perf_counter() - begin_s


def draw_chart(seconds: dict[str, list[float]]) -> Figure:
    """Draw time against the number of runs and against their length."""
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.loglog(COUNTS, seconds["by_count"], "o-", color="#0072b2")
    left.set(xlabel="runs of 60 s at 100 Hz", ylabel="time [s]", title="Number of runs")
    right.loglog(LENGTHS_S, seconds["by_length"], "o-", color="#d55e00")
    right.set(xlabel="length of each of 10 runs [s]", ylabel="time [s]", title="Length")
    for axes in (left, right):
        axes.grid(True, which="both", alpha=0.3)
    return figure
