"""Repeats a run of a study: compiled, and with the nodes in virtual time.

In virtual time the nodes run on a wire that takes no time, as the study does. The same figures are
computed from their samples and commands; every figure must equal the stored one, to the last digit.
A run of a study with a bus is one of the nodes on that bus, and repeated as such.
"""

import math
import shlex
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ...closed_loop.pair.pair_result import PairFiles, Trace
from ...closed_loop.pair.virtual_pair import make_virtual_pair, run_virtual_nodes
from ...closed_loop.studies.compiled_figures import COLUMNS, COUNTS, Figures, rules_of, verdict_of
from ...closed_loop.studies.compiled_runs import Computer
from ...closed_loop.studies.node_runs import TICKS_MAX, figures_of_trace, followed_error_m
from ...closed_loop.studies.result_files import Store
from ...closed_loop.studies.scenario import Pair
from ...plant_emulator.evaluation.run_verdict import RunEnd
from ...plant_emulator.path.path_from_settings import build_path
from ...runtime.array_types import FloatArray
from ...runtime.output_file import write_text
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
    computer: Computer, pair: Pair, trace: Trace, samples: int, sent_rad: FloatArray, end: RunEnd
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
