"""Run five laws as real processes on a CAN bus while the latency of the network grows.

    steer-by-wire demo [--out DIR] [--bus auto|socketcan|emulated] [--duration SECONDS] [--seed N]
    steer-by-wire demo --rest-bus car.dbc --load 0.3

Runs plant emulator and controller as separate processes, one pair a law, the pairs side by side in
real time, through the same phases of latency; then the same settings and seed in virtual time.
Prints which law holds the path in which phase. Writes to DIR a picture, ``summary.json`` and,
for each pair, its candump log, reports, trace and settings.
"""

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import partial

from rich.console import Console
from rich.progress import Progress

from steer_by_wire.closed_loop.pair.live_bus import BUSES, Channels, open_channels
from steer_by_wire.closed_loop.pair.live_pair import LivePair
from steer_by_wire.closed_loop.pair.pair_result import PairFiles, PairResult
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.processes.parallel_work import worker_pool
from steer_by_wire.closed_loop.processes.process_group import ProcessError
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.command_line import add_out_argument, command_parser, number, run_main
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.program.bus_options import add_traffic_arguments, bus_settings
from steer_by_wire.runtime.program.output_folder import refuse_another_run
from steer_by_wire.runtime.program.report import write_json
from steer_by_wire.tools.demo.laws_and_phases import (
    LAWS,
    DemoLaw,
    law_result,
    phases_of,
    plant_of,
    story_table,
    summary_json,
    verdict_line,
)

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
    plant: PlantSettings,
    controllers: Mapping[DemoLaw, ControllerSettings],
    bus: BusSettings,
    console: Console,
) -> dict[DemoLaw, PairResult]:
    """Run the same in virtual time."""
    start_s = time.monotonic()
    with worker_pool(VIRTUAL_WORKERS) as pool, console.status("the same in virtual time"):
        futures = {
            law: pool.submit(run_virtual_pair, plant, controller, bus)
            for law, controller in controllers.items()
        }
        results = {law: future.result() for law, future in futures.items()}
    elapsed_s = time.monotonic() - start_s
    motion_s = plant.duration_s * len(controllers)
    console.print(f"the same in virtual time: {motion_s:.0f} s of motion in {elapsed_s:.0f} s")
    return results


NAME = "steer-by-wire demo"

DURATION_S_MIN, DURATION_S_MAX = 1.0, 3600.0
"""A shorter run has no latency to draw; a longer one is no demonstration."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demo; returns the exit status."""
    parser = command_parser(NAME, __doc__, f"{NAME} --duration 10 --out out/demo")
    add_out_argument(parser, "out/demo")
    parser.add_argument(
        "--bus", choices=BUSES, default="auto",
        help="default: vcan0 if there is one, otherwise emulated",
    )  # fmt: skip
    duration = number(DURATION_S_MIN, DURATION_S_MAX, "s")
    parser.add_argument("--duration", type=duration, metavar="SECONDS", help="default: 32")
    parser.add_argument("--seed", type=int, metavar="N", help="seed of the latency; default: 1086")
    add_traffic_arguments(parser)
    return run_main(NAME, partial(_demo, parser.parse_args(arguments)))


def _demo(options: argparse.Namespace) -> int:
    from steer_by_wire.tools.demo.pictures import draw  # loads matplotlib; its help does without

    console = Console(markup=False)  # [mm] is a unit
    given = {"duration_s": options.duration, "seed": options.seed}
    overrides = [f"{key}={value}" for key, value in given.items() if value is not None]
    bus = bus_settings(options)
    plant = plant_of(overrides)
    controllers = {law: law.controller() for law in LAWS}
    files = {law: PairFiles(options.out / law.preset) for law in LAWS}
    texts = {
        f"{law.preset}/{name}": text
        for law in LAWS
        for name, text in files[law].settings_texts(plant, controllers[law]).items()
    }
    refuse_another_run(options.out, texts)
    names = [law.preset for law in LAWS]
    log = options.out / "bus.txt"
    with open_channels(options.bus, names, log, bus, plant.seed) as channels:
        for law in LAWS:
            files[law].write_settings(plant, controllers[law])
        console.print(f"bus: {channels.description}", soft_wrap=True)
        live = run_live(channels, files, plant.duration_s, console)
    virtual = run_virtual(plant, controllers, bus, console)
    results = [law_result(law, plant, live[law], virtual[law]) for law in LAWS]
    phases, out = phases_of(plant), options.out
    picture, summary = out / "lateral_error.png", out / "summary.json"
    draw(results, phases, picture)
    run = {"bus": channels.description, "plant_settings": plant.model_dump(mode="json")}
    write_json(summary, summary_json(results, phases, run))
    console.print(story_table(results, phases))
    console.print(f"picture: {picture}", soft_wrap=True)
    console.print(f"all figures: {summary}", soft_wrap=True)
    console.print(verdict_line(results), soft_wrap=True)
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
