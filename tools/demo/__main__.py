"""Drive three laws with the same latency, as real processes on a CAN bus, and draw the result.

    steer-by-wire demo [--out DIR] [--bus auto|socketcan|emulated] [--duration SECONDS] [--seed N]

Runs plant emulator and controller as separate processes, one pair a law, the pairs side by side in
real time; then the same settings and seed in virtual time. Prints a table and leaves in DIR the
pictures, ``summary.json`` and, for each pair, its candump log, reports, trace and settings.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from steer_by_wire.command_line import add_out_argument, command_parser
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.pair.channels import Channels, open_channels
from steer_by_wire.pair.live import LivePair, PairFiles, PairResult
from steer_by_wire.pair.processes import ProcessError
from steer_by_wire.pair.virtual import run_virtual_pair
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.program import ExitStatus, run_main
from steer_by_wire.runtime.settings import load_settings, read_preset
from steer_by_wire.runtime.toml_text import dump_toml
from steer_by_wire.tools.demo.pictures import LawTraces, draw_all
from steer_by_wire.tools.demo.summary import LawFigures, figures_of, summary_json, summary_table

NAME = "steer-by-wire demo"
LAWS = {"PD": "practical_pd", "PD+CDOB": "practical_pd_cdob", "PD+DDOB": "practical_pd_ddob"}
"""Labels of the pairs, and the controller's presets behind them."""

DURATION_S_MIN, DURATION_S_MAX = 1.0, 3600.0
"""A shorter run has no latency to draw; a longer one is no demonstration."""

POLL_S = 0.1
GRACE_S = 30.0
"""How much longer than its duration a run may take to start and end on a stalled machine."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demo; returns the exit status."""
    return run_main(NAME, partial(_demo, _parse(arguments)))


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = command_parser(NAME, __doc__, f"{NAME} --duration 10 --out out/demo")
    add_out_argument(parser, "out/demo")
    parser.add_argument(
        "--bus",
        choices=("auto", "socketcan", "emulated"),
        default="auto",
        help="default: vcan0 if there is one, otherwise emulated",
    )
    parser.add_argument("--duration", type=_duration, metavar="SECONDS", help="default: 30")
    parser.add_argument("--seed", type=int, metavar="N", help="seed of the latency; default: 1086")
    return parser.parse_args(arguments)


def _duration(text: str) -> float:
    """Read the length of the run; argparse turns the error into one line."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not DURATION_S_MIN <= seconds <= DURATION_S_MAX:
        raise argparse.ArgumentTypeError(
            f"allowed is {DURATION_S_MIN:g} to {DURATION_S_MAX:g} s, not {text!r}"
        )
    return seconds


def _demo(options: argparse.Namespace) -> int:
    console = Console(markup=False)  # [mm] is a unit
    plant_settings = _plant_settings(options)
    controllers = {
        label: load_settings(
            ControllerSettings, read_preset("steer_by_wire.controller.presets", preset)
        )
        for label, preset in LAWS.items()
    }
    files = {
        label: PairFiles(options.out / preset.removeprefix("practical_"))
        for label, preset in LAWS.items()
    }
    for label, settings in controllers.items():
        files[label].folder.mkdir(parents=True, exist_ok=True)
        files[label].settings("controller").write_text(dump_toml(settings), encoding="utf-8")
        files[label].settings("plant_emulator").write_text(
            dump_toml(plant_settings), encoding="utf-8"
        )
    names = [files[label].folder.name for label in LAWS]
    with open_channels(options.bus, names, options.out / "bus.txt") as channels:
        console.print(f"bus: {channels.description}", soft_wrap=True)
        console.print(f"latency: {_describe_latency(plant_settings)}")
        live = _run_live(channels, files, plant_settings.duration_s, console)
    virtual = _run_virtual(plant_settings, controllers, files, console)
    _present(options.out, console, plant_settings, channels, live, virtual)
    return ExitStatus.OK


def _plant_settings(options: argparse.Namespace) -> PlantSettings:
    """Return what the pairs drive: the demo's file, below the command line."""
    given = {"duration_s": options.duration, "seed": options.seed}
    overrides = [f"{key}={value}" for key, value in given.items() if value is not None]
    preset = read_preset("steer_by_wire.tools.demo", "demo_plant")
    return load_settings(PlantSettings, preset, overrides=overrides)


def _run_live(
    channels: Channels, files: Mapping[str, PairFiles], duration_s: float, console: Console
) -> dict[str, PairResult]:
    """Run all pairs side by side until their plants have finished."""
    with ExitStack() as stack:
        pairs = {
            label: stack.enter_context(
                LivePair(
                    bus,
                    [str(pair_files.settings("plant_emulator"))],
                    [str(pair_files.settings("controller"))],
                    pair_files,
                )
            )
            for bus, (label, pair_files) in zip(channels.buses, files.items(), strict=True)
        }
        _wait(list(pairs.values()), duration_s, console)
    return {label: pair.result() for label, pair in pairs.items()}


def _wait(pairs: Sequence[LivePair], duration_s: float, console: Console) -> None:
    """Show progress until every plant has finished; raises ProcessError if one does not."""
    start_s = time.monotonic()
    columns = (TextColumn("{task.description}"), BarColumn(40), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(f"{len(pairs)} pairs in real time", total=duration_s)
        while _running(pairs):
            elapsed_s = time.monotonic() - start_s
            if elapsed_s > duration_s + GRACE_S:
                raise ProcessError(f"a plant still runs {GRACE_S:g} s after it should have ended")
            progress.update(task, completed=min(elapsed_s, duration_s))
            time.sleep(POLL_S)
        progress.update(task, completed=duration_s)


def _running(pairs: Sequence[LivePair]) -> int:
    """Return how many plants still drive; checks every pair, because each may have died."""
    return sum(pair.plant_is_running for pair in pairs)


def _run_virtual(
    plant_settings: PlantSettings,
    controllers: Mapping[str, ControllerSettings],
    files: Mapping[str, PairFiles],
    console: Console,
) -> dict[str, PairResult]:
    """Run the same in virtual time, one pair after the other."""
    start_s = time.monotonic()
    results = {
        label: run_virtual_pair(
            plant_settings, settings, candump_log=files[label].folder / "virtual_candump.log"
        )
        for label, settings in controllers.items()
    }
    factor = len(results) * plant_settings.duration_s / (time.monotonic() - start_s)
    console.print(f"the same in virtual time: {factor:.0f} times as fast as real time")
    return results


def _present(
    out: Path,
    console: Console,
    plant_settings: PlantSettings,
    channels: Channels,
    live: Mapping[str, PairResult],
    virtual: Mapping[str, PairResult],
) -> None:
    """Print the table, draw the pictures, write the summary."""
    rows = [
        LawFigures(label, figures_of(result), figures_of(virtual[label]))
        for label, result in live.items()
    ]
    console.print(summary_table(rows))
    console.print("Pairs are median/99th percentile. Latency is what the network injects; where a")
    console.print("newer command overtakes an older one, only the newer acts: see the round trip.")
    for line in _remarks(live):
        console.print(line)
    traces = [
        LawTraces(label, result.trace, virtual[label].trace) for label, result in live.items()
    ]
    limit_rad = max(
        result.controller["settings"]["limits"]["steer_rad_max"] for result in live.values()
    )
    pictures = draw_all(
        traces, _describe_latency(plant_settings), limit_rad, _events(plant_settings), out
    )
    run: dict[str, Any] = {
        "bus": channels.description,
        "plant_settings": plant_settings.model_dump(mode="json"),
    }
    summary = out / "summary.json"
    summary.write_text(json.dumps(summary_json(rows, run, live), indent=1), encoding="utf-8")
    console.print(f"pictures: {', '.join(str(path) for path in pictures)}", soft_wrap=True)
    console.print(f"all figures: {summary}", soft_wrap=True)


def _remarks(live: Mapping[str, PairResult]) -> list[str]:
    """Print what the machine did to the run: a stalled host must not be taken for a slow loop."""
    stolen = [result.controller["host"].get("steal_fraction") for result in live.values()]
    known = [fraction for fraction in stolen if fraction is not None]
    if not known:
        return ["time stolen by the host: not known on this platform"]
    return [f"time stolen by the host during the runs: {100.0 * max(known):.1f} %"]


def _events(settings: PlantSettings) -> dict[float, str]:
    """Return the disturbances of the run in a few words, by time [s]."""
    return {
        step.at_s: "\n".join(
            f"{key} {value:g}" for key, value in step if key != "at_s" and value is not None
        )
        for step in settings.disturbance.steps
        if step.at_s < settings.duration_s
    }


def _describe_latency(settings: PlantSettings) -> str:
    """Return the command's latency in a few words."""
    downlink = settings.latency.downlink
    return (
        f"commands {1e3 * downlink.mean_s:.0f} ± {1e3 * downlink.spread_s:.0f} ms"
        f" ({downlink.model}), {100.0 * downlink.loss:g} % lost, seed {settings.seed}"
    )


if __name__ == "__main__":
    sys.exit(main())
