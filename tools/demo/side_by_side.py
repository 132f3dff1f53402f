"""Runs the pairs of all laws: side by side in real time, and the same in virtual time."""

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack

from rich.console import Console
from rich.progress import Progress

from ...closed_loop.pair.live_bus import Channels
from ...closed_loop.pair.live_pair import LivePair
from ...closed_loop.pair.pair_result import PairFiles, PairResult
from ...closed_loop.pair.virtual_pair import run_virtual_pair
from ...closed_loop.processes.parallel_work import worker_pool
from ...closed_loop.processes.process_group import ProcessError
from ...controller.settings import ControllerSettings
from ...plant_emulator.settings import PlantSettings
from ...runtime.bus_model.settings import BusSettings
from .laws_and_phases import DemoLaw

VIRTUAL_WORKERS = 2
POLL_S = 0.1
GRACE_S = 30.0
"""How much longer than its duration a run may take to start and end on a stalled machine."""


def run_live(
    channels: Channels, files: Mapping[DemoLaw, PairFiles], duration_s: float, console: Console
) -> dict[DemoLaw, PairResult]:
    """Run all pairs at the same time, each on a channel; raises ProcessError."""
    with ExitStack() as stack:
        pairs = {
            law: stack.enter_context(LivePair(bus, pair_files))
            for bus, (law, pair_files) in zip(channels.buses, files.items(), strict=True)
        }
        _wait(list(pairs.values()), duration_s, console)
    for law, pair in pairs.items():
        if pair.recording_failure:
            console.print(f"log of {law.label} ends early: {pair.recording_failure}")
    return {law: pair.result() for law, pair in pairs.items()}


def _wait(pairs: Sequence[LivePair], duration_s: float, console: Console) -> None:
    """Show progress until every plant has finished; raises ProcessError if one does not."""
    start_s = time.monotonic()
    with Progress(console=console) as progress:
        task = progress.add_task(f"{len(pairs)} pairs in real time", total=duration_s)
        while sum(pair.plant_is_running for pair in pairs):
            elapsed_s = time.monotonic() - start_s
            if elapsed_s > duration_s + GRACE_S:
                raise ProcessError(f"a plant still runs {GRACE_S:g} s after it should have ended")
            progress.update(task, completed=min(elapsed_s, duration_s))
            time.sleep(POLL_S)
        progress.update(task, completed=duration_s)


def run_virtual(
    plants: Mapping[DemoLaw, PlantSettings],
    controllers: Mapping[DemoLaw, ControllerSettings],
    bus: BusSettings,
    console: Console,
) -> dict[DemoLaw, PairResult]:
    """Run the same in virtual time."""
    start_s = time.monotonic()
    with worker_pool(VIRTUAL_WORKERS) as pool, console.status("the same in virtual time"):
        futures = {
            law: pool.submit(run_virtual_pair, plants[law], controllers[law], bus) for law in plants
        }
        results = {law: future.result() for law, future in futures.items()}
    elapsed_s = time.monotonic() - start_s
    motion_s = sum(settings.duration_s for settings in plants.values())
    console.print(f"the same in virtual time: {motion_s:.0f} s of motion in {elapsed_s:.0f} s")
    return results
