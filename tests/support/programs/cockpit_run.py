"""The cockpit as a program, a recorded run for it, and a sampler that has taken the run."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.network.settings import BothLatencySettings, LatencySettings
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.tools.cockpit.sampler import Sampler
from tests.support.frames.recorded_frames import entries_in
from tests.support.programs.running_program import PATIENCE_S

NS = 1_000_000_000
PLANT = PlantSettings(
    duration_s=12.0, latency=BothLatencySettings(downlink=LatencySettings(mean_s=0.08))
)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record 12 s with 80 ms down; returns the log."""
    file = tmp_path_factory.mktemp("cockpit") / "run.log"
    run_virtual_pair(PLANT, controller_preset("practical_pd_ddob"), candump_log=file)
    return file


def fed(log: Path) -> tuple[Sampler, int]:
    """Return a sampler that has taken a recording, and the time of its last frame [ns]."""
    sampler, now_ns = Sampler(0, build_path(PLANT.path)), 0
    for now_ns, _channel, frame in entries_in(log):
        sampler.on_frame(frame, now_ns)
    return sampler, now_ns


@contextmanager
def cockpit(*options: str) -> Iterator[str]:
    """Run the program; yields the address of its page."""
    command = [sys.executable, "-m", "steer_by_wire", "cockpit", "--no-browser", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"open (http://127\.0\.0\.1:\d+/[\w-]+/)$", process.stdout.readline())
            assert found is not None
            yield found[1]
        finally:
            process.terminate()
            assert process.wait(PATIENCE_S) == 0
