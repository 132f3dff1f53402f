"""Time of real programs: a start up to its first frame, and a minute in lockstep with C.

The targets: a first frame within 1 s; a minute within 1 s on the host, within 3 s on a Cortex-M7.
"""

import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.closed_loop.lockstep.node import controller_node
from steer_by_wire.closed_loop.pair.live_bus import Bus
from steer_by_wire.closed_loop.pair.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_plant, run_virtual_nodes
from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.bus_model import BusModel

PRESETS = {"plant_emulator": "paper_nominal", "controller": "practical_pd_ddob"}
MAKEFILE = Path(__file__).parents[1] / "examples/foreign_controller_c/Makefile"
TOOLS = ("gcc", "make", "arm-none-eabi-gcc", "qemu-system-arm")
QEMU = shlex.split(
    "qemu-system-arm -M mps2-an500 -nographic -serial none -monitor none"
    " -semihosting-config enable=on,target=native -kernel"
)
CONTROLLERS = ("our own", "C library", "C program", "Cortex-M7 in QEMU")


@pytest.fixture
def bus() -> Iterator[Bus]:
    with launched_broker() as address:
        yield Bus("emulated", "startup", {"address": address})


@pytest.mark.benchmark(group="start to first frame")
@pytest.mark.parametrize("program", PRESETS)
def test_start(program: str, benchmark: Any, bus: Bus) -> None:
    command = [sys.executable, "-P", "-m", f"steer_by_wire.{program}", *bus.options]
    command += ["--preset", PRESETS[program]]

    def first_frame() -> subprocess.Popen[bytes]:
        with bus.open() as listener:
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            assert listener.recv(30.0) is not None
        return process

    def end(process: subprocess.Popen[bytes]) -> None:
        process.send_signal(signal.SIGINT)
        process.wait()

    started: list[subprocess.Popen[bytes]] = []
    for _ in range(2):  # the first start may write bytecode
        end(first_frame())
    benchmark.pedantic(
        lambda: started.append(first_frame()), teardown=lambda: end(started.pop()), rounds=5
    )


@pytest.fixture(scope="module")
def controllers(
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, ControllerSettings | Sequence[str]]:
    if missing := [tool for tool in TOOLS if shutil.which(tool) is None]:
        pytest.skip(f"this machine has no {', '.join(missing)}")
    folder = tmp_path_factory.mktemp("lockstep")
    make = ["make", "-s", "-f", str(MAKEFILE), f"PYTHON={sys.executable}"]
    programs = ["lockstep.so", "on_lockstep", "on_m7.elf"]
    subprocess.run([*make, *programs], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    library, host, firmware = (str(folder / name) for name in programs)
    every = (controller_preset("practical_pd"), [library], [host], [*QEMU, firmware])
    return dict(zip(CONTROLLERS, every, strict=True))


@pytest.mark.benchmark(group="60 s in lockstep")
@pytest.mark.parametrize("name", CONTROLLERS)
def test_lockstep(
    name: str, benchmark: Any, controllers: dict[str, ControllerSettings | Sequence[str]]
) -> None:
    def run() -> None:
        _, edge = make_virtual_plant(PlantSettings(duration_s=60.0))
        with controller_node(controllers[name]) as node:
            run_virtual_nodes(edge, node, BusModel(QUIET_BUS.bitrate_bit_s), None, lambda: False)
        assert not node.report()["failure"]

    benchmark.pedantic(run, rounds=5)
