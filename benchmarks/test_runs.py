"""Time of whole runs: in virtual time, compiled, on two threads and processes, from a cold start.

The targets: 20 s of motion in virtual time in 0.1 s; 1,700 compiled runs of a minute in a second
on one thread; two threads 1.8 times as fast as one; a first compiled result within 5 s; 800 minutes
of a car alone in a second on one thread, several at once.
"""

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.compiled.schedule import schedule_run
from steer_by_wire.closed_loop.identification.parameters import Known, values_of
from steer_by_wire.closed_loop.identification.response import LANES, STEP_S, Grid, respond
from steer_by_wire.closed_loop.identification.time_series import Channel, Quantity
from steer_by_wire.closed_loop.pair.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair, run_virtual_nodes
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.bus_model.bus_model import BusModel

RUNS = 40
WIRES = {"ideal wire": None, "500 kbit/s": QUIET_BUS.bitrate_bit_s}
NETWORKS = {
    "80 ms": ("mean_s=0.08",),
    "83.7213 ms": ("mean_s=0.0837213",),
    "jitter and loss": ("model=gamma", "mean_s=0.08", "spread_s=0.03", "loss=0.01"),
}
POOLS: dict[str, tuple[type[ThreadPoolExecutor | ProcessPoolExecutor], int]] = {
    "one thread": (ThreadPoolExecutor, 1),
    "two threads": (ThreadPoolExecutor, 2),
    "two processes": (ProcessPoolExecutor, 2),
}
FIRST_RESULT = """
from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.settings import plant_preset
run_compiled(plant_preset("paper_corner_d"), controller_preset("practical_pd_ddob"))
"""


def pair_settings(network: Sequence[str]) -> tuple[PlantSettings, ControllerSettings]:
    overrides = ["duration_s=60", *(f"latency.downlink.{setting}" for setting in network)]
    return plant_preset("paper_corner_d", overrides), controller_preset("practical_pd_ddob")


@pytest.mark.benchmark(group="20 s in virtual time")
@pytest.mark.parametrize("wire", WIRES)
def test_virtual_time(wire: str, benchmark: Any) -> None:
    bitrate_bit_s = WIRES[wire]

    def prepared() -> tuple[tuple[Any, ...], dict[str, Any]]:
        pair = make_virtual_pair(
            PlantSettings(duration_s=20.0), controller_preset("practical_pd_ddob")
        )
        bus = None if bitrate_bit_s is None else BusModel(bitrate_bit_s)
        return (pair.edge, pair.controller, bus, None, lambda: False), {}

    benchmark.pedantic(run_virtual_nodes, setup=prepared, rounds=7)


@pytest.mark.benchmark(group="60 s compiled")
@pytest.mark.parametrize("network", NETWORKS)
def test_compiled_run(network: str, benchmark: Any) -> None:
    plant, controller = pair_settings(NETWORKS[network])
    benchmark(run_compiled, plant, controller, schedule_run(plant, controller))


@pytest.mark.benchmark(group="60 s of network laid down")
@pytest.mark.parametrize("network", NETWORKS)
def test_schedule(network: str, benchmark: Any) -> None:
    benchmark(schedule_run, *pair_settings(NETWORKS[network]))


def test_cars_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    """With two sensors at 100 Hz; by processor time and in turns, as a computer's load changes."""
    plant, time_s = plant_preset("large_sedan"), np.arange(0.0, 60.0, STEP_S)
    zero = "lag_squared_s2", "delay_and_lag_s", "steering_offset_rad", "yaw_rate_offset_rad_s"
    assert plant.car is not None
    values = dict.fromkeys(zero, 0.0) | values_of(plant.vehicle, plant.car)
    values["steering_ratio"] = 1.0
    steering_rad, still = 0.03 * np.sin(3.0 * time_s), np.zeros_like(time_s)
    speed_m_s, ends = still + 20.0, np.array([0, len(time_s)])
    sensed = Quantity.YAW_RATE, Quantity.LATERAL_ACCELERATION
    judged = tuple(Channel(one, one, time_s[1000::10], still[1000::10]) for one in sensed)
    grid = Grid(judged, STEP_S, ends, still[:1], time_s, steering_rad, speed_m_s, still, still[:0])
    rates: dict[int, list[float]] = {LANES: [], 1: []}
    for _ in range(16):
        for cars, found in rates.items():
            begin_s = time.thread_time()
            respond(grid, [values] * cars, Known())
            found.append(cars / (time.thread_time() - begin_s))
    at_once, alone = (found[1:] for found in rates.values())
    times = statistics.median(np.divide(at_once, alone))
    with capsys.disabled():
        sys.stdout.write(
            "minutes of a car alone in a second on one thread, median (best):"
            f" {LANES} at once {statistics.median(at_once):.0f} ({max(at_once):.0f}), one by one"
            f" {statistics.median(alone):.0f} ({max(alone):.0f}), {times:.2f} times\n"
        )


def some_runs(count: int) -> None:
    plant, controller = pair_settings(NETWORKS["80 ms"])
    plan = schedule_run(plant, controller)
    for _ in range(count):
        run_compiled(plant, controller, plan)


def shared_out(pool: Executor, workers: int) -> None:
    list(pool.map(some_runs, [2 * RUNS // workers] * workers))


@pytest.mark.benchmark(group=f"{2 * RUNS} compiled runs")
@pytest.mark.parametrize("workers", POOLS)
def test_workers(workers: str, benchmark: Any) -> None:
    kind, count = POOLS[workers]
    with kind(count) as pool:
        shared_out(pool, count)
        benchmark.pedantic(shared_out, (pool, count), rounds=7)


@pytest.mark.benchmark(group="import to first compiled result")
@pytest.mark.parametrize("start", ["cold", "warm"])
def test_first_result(start: str, benchmark: Any, tmp_path: Path) -> None:
    def first_result(cache: Path) -> None:
        environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
        command = (sys.executable, "-P", "-c", FIRST_RESULT)
        subprocess.run(command, check=True, env=environment)

    caches = iter(tmp_path / (start if start == "warm" else str(number)) for number in range(9))
    if start == "warm":
        first_result(next(caches))
    benchmark.pedantic(first_result, setup=lambda: ((next(caches),), {}), rounds=5)
