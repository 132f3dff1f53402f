"""Repeats runs of a study: compiled, with the nodes in virtual time, and with the real programs.

In virtual time the nodes run on a wire that takes no time, as the study does. The same figures are
computed from their samples and commands; every figure must equal the stored one, to the last digit.
A run of a study with a bus is one of the nodes on that bus, and repeated as such.

The real programs run on a bus, and are compared with the study's own results. Each run takes its
own time. The time on the wire and the wake-ups of the programs differ; the latencies, losses and
noise are the same, drawn from the same seed.
"""

import json
import math
import shlex
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...closed_loop.live_bus import Bus, open_channels
from ...closed_loop.live_pair import LivePair
from ...closed_loop.pair_result import PairFiles, Trace
from ...closed_loop.process_group import ProcessError
from ...closed_loop.studies.compiled_figures import COLUMNS, COUNTS, Figures, rules_of, verdict_of
from ...closed_loop.studies.compiled_runs import Computer
from ...closed_loop.studies.node_runs import (
    TICKS_MAX,
    figures_of_trace,
    followed_error_m,
    range_left,
)
from ...closed_loop.studies.result_files import Store
from ...closed_loop.studies.scenario import Pair
from ...closed_loop.virtual_pair import make_virtual_pair, run_virtual_nodes
from ...plant_emulator.evaluation.run_verdict import RunEnd
from ...plant_emulator.path.ellipse_and_lane_changes import build_path
from ...runtime.array_types import FloatArray
from ...runtime.output_file import write_text
from ...runtime.port.interface_choice import socketcan_obstacle
from ...runtime.settings import SettingsError
from ...runtime.settings.toml_text import dump_toml

BUS = "bus"


class Replay(NamedTuple):
    """One repeated run.

    ``stored``    the row; None where the study has not reached it yet
    ``compiled``  figures by column, and the verdict, computed anew
    ``virtual``   figures of the nodes; empty where there was nothing to run
    """

    pair: Pair
    files: PairFiles
    stored: Mapping[str, Any] | None
    compiled: Mapping[str, Any]
    virtual: Mapping[str, Any]

    @property
    def differences(self) -> list[str]:
        """Columns in which the three do not agree to the last digit."""
        views = [view for view in (self.stored, self.virtual) if view]
        return [
            name
            for name, value in self.compiled.items()
            if any(name in view and not _same(view[name], value) for view in views)
        ]


def replay(store: Store, computer: Computer, run: int) -> Replay:
    """Repeat run number ``run``; raises SettingsError where there is none of this number."""
    scenarios = computer.scenarios
    study = scenarios.study
    if not 0 <= run < study.runs:
        raise SettingsError(f"--replay {run}: the study has runs 0 to {study.runs - 1}")
    pair = scenarios.pair(run)
    files = PairFiles(store.folder / "replay" / str(run))
    files.write_settings(pair.plant, pair.controller)
    row = np.full(len(COLUMNS), np.nan)
    end = computer.run(pair, row)
    verdict = verdict_of(study.settings.verdict, end, row)
    compiled = {**_named(row.tolist(), end), "verdict": str(verdict)}
    if pair.bus is not None:
        write_text(files.settings(BUS), dump_toml(pair.bus))
        return Replay(pair, files, store.find(run), compiled, compiled)
    virtual = {} if end is RunEnd.NO_START else _virtual(computer, pair, compiled, end)
    return Replay(pair, files, store.find(run), compiled, virtual)


def commands(pair: Pair, files: PairFiles) -> list[str]:
    """Return the commands that repeat the run, in virtual time and, without a bus, live."""
    bus = files.settings(BUS)
    plant, controller = (
        shlex.quote(str(files.settings(name))) for name in ("plant_emulator", "controller")
    )
    program = f"--controller-command {shlex.quote(shlex.join(pair.command))}"
    run = f"steer-by-wire run {plant} {program if pair.command else f'--controller {controller}'}"
    run += f" --dialect {shlex.quote(pair.dialect)}" if pair.dialect else ""
    if bus.exists():
        return [f"{run} --bus-settings {shlex.quote(str(bus))}"]
    return [
        f"{run} --ideal-wire",
        f"steer-by-wire plant {plant} --interface socketcan --channel vcan0 & "
        f"steer-by-wire controller {controller} --interface socketcan --channel vcan0",
    ]


def _virtual(
    computer: Computer, pair: Pair, compiled: Mapping[str, Any], end: RunEnd
) -> dict[str, Any]:
    """Return the figures of the two nodes, up to where the compiled run ended."""
    made = make_virtual_pair(pair.plant, pair.controller, controller_samples_max=TICKS_MAX)
    plant, controller = made.plant, made.controller
    samples, ticks = compiled["samples"], compiled["commands_sent"]
    is_complete = end is RunEnd.COMPLETE
    run_virtual_nodes(
        *(made.edge, controller, None, None),
        lambda: not is_complete and len(plant.samples) > samples > 0,
    )
    sent_rad = np.array([sample.sent_steer_rad for sample in controller.samples][:ticks])
    found = _figures(computer, pair, Trace.of_node(plant), samples, sent_rad, end)
    if is_complete:
        report = plant.report()
        found["samples"] = len(plant.samples)
        found["commands_sent"] = len(controller.samples)
        found["downlink_lost"] = report["downlink"]["lost"]
        found["uplink_lost"] = report["uplink"]["lost"]
    return found


def _figures(
    computer: Computer,
    pair: Pair,
    trace: Trace,
    samples: int,
    sent_rad: FloatArray,
    end: RunEnd,
) -> dict[str, Any]:
    """Return the figures of the first samples of a trace, and the verdict."""
    judged_by = computer.scenarios.study.settings.verdict
    rules = rules_of(judged_by, pair.plant, pair.controller)
    followed_m = followed_error_m(build_path(pair.plant.path), trace, rules.behind_preview_m)
    figures = figures_of_trace(rules, pair.plant, trace, followed_m, samples, sent_rad)
    return {**figures._asdict(), "verdict": str(verdict_of(judged_by, end, np.array(figures)))}


def _named(row: list[float], end: RunEnd) -> dict[str, Any]:
    values: dict[str, Any] = dict(zip(COLUMNS, row, strict=True))
    return {"ended_by": str(end), **values, **{name: int(values[name]) for name in COUNTS}}


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return one == other or (math.isnan(one) and math.isnan(other))
    return bool(one == other)


def replay_lines(made: Replay) -> list[str]:
    """Return the table of a replay."""
    lines = [f"{'':22}{'stored':>24}{'virtual time':>24}"]
    for name in ("verdict", "ended_by", *Figures._fields, *COUNTS):
        stored = "-" if made.stored is None else _text(made.stored[name])
        virtual = _text(made.virtual[name]) if name in made.virtual else "-"
        mark = "  DIFFERS" if name in made.differences else ""
        lines.append(f"{name:22}{stored:>24}{virtual:>24}{mark}")
    return lines


def _text(value: Any) -> str:
    return repr(value) if isinstance(value, float) else str(value)


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
        with open_channels("emulated", ["study"], folder / "bus.txt") as channels:
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
    return _figures(computer, pair, trace, samples, np.zeros(0), end)


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
    write_text(file, json.dumps(rows, indent=1))
