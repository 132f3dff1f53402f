"""Runs of a study with the real programs on a bus, compared with the study's own results.

Each run takes its own time. The time on the wire and the wake-ups of the programs differ; the
latencies, losses and noise are the same, drawn from the same seed.
"""

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...pair.channels import open_channels
from ...pair.live import Bus, LivePair, PairFiles
from ...pair.processes import ProcessError
from ...pair.trace import Trace
from ...plant_emulator.verdict import RunEnd
from ...runtime.bus import socketcan_obstacle
from ...runtime.settings import SettingsError
from ...studies.compute import Computer
from ...studies.figures import COLUMNS
from ...studies.on_nodes import figures_of_trace, range_left
from ...studies.scenario import Pair
from ...studies.verdict import rules_of, verdict_of

GRACE_S = 30.0
"""How much longer than its motion a run may take on a stalled machine."""
POLL_S = 0.1
COMPARED = (
    "verdict",
    "rms_m",
    "peak_m",
    "cg_rms_m",
    "amplitude_m",
    "latency_mean_s",
    "latency_p99_s",
)
"""Figures that are compared; a plant's trace does not contain the commands' limits."""


class LiveRun(NamedTuple):
    """One run: figures of the study, and those of the real programs."""

    run: int
    study: Mapping[str, Any]
    live: Mapping[str, Any]


def subset(runs: int, count: int) -> list[int]:
    """Return ``count`` ids spread evenly over a study, the same ones every time."""
    count = min(count, runs)
    return [(2 * index + 1) * runs // (2 * count) for index in range(count)]


@contextmanager
def open_bus(name: str, folder: Path) -> Iterator[Bus]:
    """Open the bus that ``--live`` names, until the end of the block.

    ``name``  emulated: a bus of its own; a SocketCAN interface such as vcan0; or INTERFACE:CHANNEL
              of python-can

    Raises SettingsError.
    """
    if name == "emulated":
        with open_channels("emulated", ["stress"], folder / "bus.txt") as channels:
            yield channels.buses[0]
        return
    interface, colon, channel = name.partition(":")
    if colon and not (interface and channel):
        raise SettingsError(f"--live {name}: is neither emulated, vcan0 nor INTERFACE:CHANNEL")
    if not colon:
        interface, channel = "socketcan", name
    obstacle = socketcan_obstacle(channel) if interface == "socketcan" else ""
    if obstacle:
        raise SettingsError(f"--live {name}: {obstacle}")
    yield Bus(interface, channel, {})


def run_live(
    computer: Computer,
    ids: Sequence[int],
    bus: Bus,
    folder: Path,
    on_run: Callable[[LiveRun], None],
    should_stop: Callable[[], bool],
) -> list[LiveRun]:
    """Run each of ``ids`` live, one after the other; raises ProcessError, and as opening does."""
    done: list[LiveRun] = []
    for run in ids:
        pair = computer.scenarios.pair(run)
        files = PairFiles(folder / str(run))
        files.write_settings(pair.plant, pair.controller)
        row = np.full(len(COLUMNS), np.nan)
        end = computer.one(pair.plant, pair.controller, row)
        if end is RunEnd.NO_START or not _drive(pair, bus, files, should_stop):
            if should_stop():
                break
            continue
        study = dict(zip(COLUMNS, row.tolist(), strict=True))
        study["verdict"] = str(verdict_of(computer.scenarios.study.settings.verdict, end, row))
        done.append(
            LiveRun(run, study, live_figures(computer, pair, Trace.read(files.plant_trace)))
        )
        on_run(done[-1])
        _write(folder / "live.json", done)
    return done


def live_figures(computer: Computer, pair: Pair, trace: Trace) -> dict[str, Any]:
    """Return the figures of a plant's trace."""
    has_left, samples = range_left(trace)
    end = RunEnd.LEFT_RANGE if has_left else RunEnd.COMPLETE
    judged_by = computer.scenarios.study.settings.verdict
    rules = rules_of(judged_by, pair.plant, pair.controller)
    figures = figures_of_trace(rules, trace, samples, np.zeros(0))
    verdict = verdict_of(judged_by, end, np.array(figures))
    return {**figures._asdict(), "verdict": str(verdict)}


def live_line(one: LiveRun) -> str:
    """Return one run in a line: study, then live."""
    parts = [f"run {one.run}"]
    for name in COMPARED:
        study, live = one.study[name], one.live[name]
        if isinstance(study, str):
            parts.append(study if study == live else f"{study} -> {live}")
        else:
            label = name.rpartition("_")[0].replace("_", " ")
            parts.append(f"{label} {1e3 * study:.1f} -> {1e3 * live:.1f} m{name[-1]}")
    return ", ".join(parts)


def _drive(pair: Pair, bus: Bus, files: PairFiles, should_stop: Callable[[], bool]) -> bool:
    with LivePair(bus, files) as live:
        end_s = time.monotonic() + pair.plant.duration_s + GRACE_S
        while live.plant_is_running:
            if should_stop():
                return False
            if time.monotonic() > end_s:
                raise ProcessError(f"the plant still runs {GRACE_S:g} s after it should have ended")
            time.sleep(POLL_S)
    live.result()
    return True


def _write(file: Path, runs: Sequence[LiveRun]) -> None:
    """Write the runs as JSON, which has no NaN."""

    def known(figures: Mapping[str, Any]) -> dict[str, Any]:
        return {
            name: None if isinstance(value, float) and math.isnan(value) else value
            for name, value in figures.items()
        }

    rows = [{"run": one.run, "study": known(one.study), "live": known(one.live)} for one in runs]
    file.write_text(json.dumps(rows, indent=1), encoding="utf-8")
