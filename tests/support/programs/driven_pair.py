"""Both programs as real processes on a bus, until the plant has come to its end."""

import time
from pathlib import Path

from steer_by_wire.closed_loop.pair.live_bus import Bus
from steer_by_wire.closed_loop.pair.live_pair import LivePair
from steer_by_wire.closed_loop.pair.pair_result import PairFiles, PairResult
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.node.overruns import OverrunSettings
from tests.support.programs.running_program import PATIENCE_S

BEAR_ALL = OverrunSettings(overruns_max="off", missed_periods_max="off")
"""A node of a busy machine misses most of its periods, and would end for that in its safe state."""
CONTROLLER = controller_preset("practical_pd_ddob").model_copy(update={"overruns": BEAR_ALL})


def drive_pair(bus: Bus, folder: Path, plant: PlantSettings) -> PairResult:
    """Return what both have left in ``folder``; raises unless both have ended with status 0."""
    files = PairFiles(folder)
    files.write_settings(plant, CONTROLLER)
    with LivePair(bus, files) as pair:
        until_s = time.monotonic() + PATIENCE_S
        while pair.plant_is_running:
            assert time.monotonic() < until_s, "the plant does not come to its end"
            time.sleep(0.05)
    return pair.result()
