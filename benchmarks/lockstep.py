"""Times a minute at 100 Hz with the C example in lockstep: on the host, and on a Cortex-M7."""

import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.measurement import Line, Target
from steer_by_wire.closed_loop.lockstep.node import controller_node
from steer_by_wire.closed_loop.pair.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_plant, run_virtual_nodes
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.quiet_bus import QuietBus

MOTION_S = 60.0
REPETITIONS = 5
HOST_TARGET_S, HOST_TARGET_RATIO, M7_TARGET_S = 1.0, 1.3, 3.0
MAKEFILE = Path(__file__).parents[1] / "examples/foreign_controller_c/Makefile"
TOOLS = ("gcc", "make", "arm-none-eabi-gcc", "qemu-system-arm")
QEMU = shlex.split(
    "qemu-system-arm -M mps2-an500 -nographic -serial none -monitor none"
    " -semihosting-config enable=on,target=native -kernel"
)


def missing_tools() -> list[str]:
    """Return which programs these lines need and this machine has not."""
    return [tool for tool in TOOLS if shutil.which(tool) is None]


def lockstep_lines() -> list[Line]:
    """Measure our own controller, the C program and the firmware in turn, on a bus."""
    own, host, m7 = "our own controller", "C program", "Cortex-M7 in QEMU"
    with tempfile.TemporaryDirectory() as folder:
        make = ["make", "-s", "-f", str(MAKEFILE), f"PYTHON={sys.executable}"]
        programs = ["on_lockstep", "on_m7.elf"]
        subprocess.run([*make, *programs], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        program, firmware = (str(Path(folder, name)) for name in programs)
        controllers: dict[str, ControllerSettings | Sequence[str]] = {
            own: controller_preset("practical_pd"),
            host: [program],
            m7: [*QEMU, firmware],
        }
        times_s: dict[str, list[float]] = {name: [] for name in controllers}
        for _ in range(REPETITIONS):
            for name, controller in controllers.items():
                times_s[name].append(_run_s(controller))
    ratios = [c_s / own_s for c_s, own_s in zip(times_s[host], times_s[own], strict=True)]
    targets = {
        host: Target(at_most=True, value=HOST_TARGET_S),
        m7: Target(at_most=True, value=M7_TARGET_S),
    }
    work_us = {name: [1e6 * one for one in took_s] for name, took_s in times_s.items()}
    lines = [
        Line(f"{MOTION_S:g} s, {name}", "s", took_s, work_us[name], targets.get(name))
        for name, took_s in times_s.items()
    ]
    target = Target(at_most=True, value=HOST_TARGET_RATIO)
    return [*lines, Line(f"{host} / {own}", "", ratios, work_us[host], target)]


def _run_s(controller: ControllerSettings | Sequence[str]) -> float:
    """Return how long a run takes, the start of the program not counted [s]."""
    _, edge = make_virtual_plant(PlantSettings(duration_s=MOTION_S))
    with controller_node(controller) as node:
        begin_s = time.perf_counter()
        bus = QuietBus(QUIET_BUS.bitrate_bit_s)
        run_virtual_nodes(edge, node, bus, None, lambda: False)
        elapsed_s = time.perf_counter() - begin_s
    if failure := node.report()["failure"]:
        raise RuntimeError(failure)
    return elapsed_s
