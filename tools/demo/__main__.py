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
from collections.abc import Sequence
from functools import partial

from rich.console import Console

from steer_by_wire.closed_loop.pair.live_bus import BUSES, open_channels
from steer_by_wire.closed_loop.pair.pair_result import PairFiles
from steer_by_wire.runtime.command_line import add_out_argument, command_parser, number, run_main
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.program.bus_options import add_traffic_arguments, bus_settings
from steer_by_wire.runtime.program.output_folder import refuse_another_run
from steer_by_wire.runtime.program.report import write_json
from steer_by_wire.tools.demo.laws_and_phases import (
    LAWS,
    law_result,
    phases_of,
    story_table,
    summary_json,
    verdict_line,
)
from steer_by_wire.tools.demo.pictures import draw
from steer_by_wire.tools.demo.side_by_side import run_live, run_virtual

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
    console = Console(markup=False)  # [mm] is a unit
    given = {"duration_s": options.duration, "seed": options.seed}
    overrides = [f"{key}={value}" for key, value in given.items() if value is not None]
    bus = bus_settings(options)
    plants = {law: law.plant(overrides) for law in LAWS}
    controllers = {law: law.controller() for law in LAWS}
    files = {law: PairFiles(options.out / law.preset) for law in LAWS}
    texts = {
        f"{law.preset}/{name}": text
        for law in LAWS
        for name, text in files[law].settings_texts(plants[law], controllers[law]).items()
    }
    refuse_another_run(options.out, texts)
    names = [law.preset for law in LAWS]
    plant = plants[LAWS[0]]
    log = options.out / "bus.txt"
    with open_channels(options.bus, names, log, bus, plant.seed) as channels:
        for law in LAWS:
            files[law].write_settings(plants[law], controllers[law])
        console.print(f"bus: {channels.description}", soft_wrap=True)
        live = run_live(channels, files, plant.duration_s, console)
    virtual = run_virtual(plants, controllers, bus, console)
    results = [law_result(law, plants[law], live[law], virtual[law]) for law in LAWS]
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
