"""One run of a study, repeated with the nodes in virtual time.

The nodes run on a wire that takes no time, as the compiled run does. Their figures are computed
from their samples and commands, and every figure must equal the stored one, to the last digit. A
run of a study with a bus is repeated on that bus.
"""

import math
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...closed_loop.pair.pair_result import BUS, PairFiles, Trace
from ...closed_loop.pair.virtual_pair import make_virtual_pair, run_virtual_nodes
from ...closed_loop.studies.compiled_figures import COLUMNS, COUNTS, Figures, rules_of, verdict_of
from ...closed_loop.studies.compiled_runs import Computer
from ...closed_loop.studies.node_runs import TICKS_MAX, figures_of_trace, followed_error_m
from ...closed_loop.studies.result_files import Store
from ...closed_loop.studies.scenario import Pair
from ...dbc.bus_language import read_language
from ...plant_emulator.evaluation.run_verdict import RunEnd, VerdictRules
from ...runtime.settings import SettingsError


class Replay(NamedTuple):
    """One repeated run.

    ``stored``    the row; None where the study has not reached it yet
    ``expected``  what the nodes have to reproduce: the row, or the figures of a new run
    ``nodes``     figures of the nodes; empty where there was nothing to run
    """

    pair: Pair
    files: PairFiles
    stored: Mapping[str, Any] | None
    expected: Mapping[str, Any]
    nodes: Mapping[str, Any]

    @property
    def differences(self) -> list[str]:
        """Columns that the nodes do not reproduce to the last digit."""
        found, expected = self.nodes, self.expected
        return [name for name in found if not _same(found[name], expected[name])]


def replay(store: Store, computer: Computer, run: int) -> Replay:
    """Repeat run number ``run``; raises SettingsError where there is none of this number."""
    scenarios = computer.scenarios
    study = scenarios.study
    if not 0 <= run < study.runs:
        raise SettingsError(f"--replay {run}: the study has runs 0 to {study.runs - 1}")
    pair = scenarios.pair(run)
    files = PairFiles(store.folder / "replay" / str(run))
    others = [*read_language(pair.dialect).files, *map(Path, pair.command)]
    files.write_settings(pair.plant, pair.controller, pair.bus, others)
    stored = store.find(run)
    if pair.bus is not None:
        nodes = _computed(computer, pair)
        return Replay(pair, files, stored, stored or nodes, nodes)
    expected = stored or _computed(computer, pair)
    end = RunEnd(expected["ended_by"])
    nodes = {} if end is RunEnd.NO_START else _virtual(pair, study.settings.verdict, expected, end)
    return Replay(pair, files, stored, expected, nodes)


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


def _computed(computer: Computer, pair: Pair) -> dict[str, Any]:
    """Return what the study stores of a run."""
    row = np.full(len(COLUMNS), np.nan)
    end = computer.run(pair, row)
    values: dict[str, Any] = dict(zip(COLUMNS, row.tolist(), strict=True))
    values |= {name: int(values[name]) for name in COUNTS}
    verdict = verdict_of(computer.scenarios.study.settings.verdict, end, row)
    return {"ended_by": str(end), **values, "verdict": str(verdict)}


def _virtual(
    pair: Pair, judged_by: VerdictRules, expected: Mapping[str, Any], end: RunEnd
) -> dict[str, Any]:
    """Return the figures of the two nodes, up to where the compiled run ended."""
    made = make_virtual_pair(pair.plant, pair.controller, controller_samples_max=TICKS_MAX)
    plant, controller = made.plant, made.controller
    samples, is_complete = expected["samples"], end is RunEnd.COMPLETE
    run_virtual_nodes(
        *(made.edge, controller, None, None),
        lambda: not is_complete and len(plant.samples) > samples > 0,
    )
    commands_rad = [sample.sent_steer_rad for sample in controller.samples]
    sent_rad = np.array(commands_rad[: expected["commands_sent"]])
    rules, trace = rules_of(judged_by, pair.plant, pair.controller), Trace.of_node(plant)
    followed_m = followed_error_m(plant.path, trace, rules.behind_preview_m)
    figures = figures_of_trace(rules, pair.plant, trace, followed_m, samples, sent_rad)
    found = {**figures._asdict(), "verdict": str(verdict_of(judged_by, end, np.array(figures)))}
    if is_complete:
        report = plant.report()
        found["samples"] = len(plant.samples)
        found["commands_sent"] = len(controller.samples)
        found["downlink_lost"] = report["downlink"]["lost"]
        found["uplink_lost"] = report["uplink"]["lost"]
    return found


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return one == other or (math.isnan(one) and math.isnan(other))
    return bool(one == other)


def replay_lines(made: Replay) -> list[str]:
    """Return the table of a replay."""
    lines = [f"{'':22}{'stored':>24}{'virtual time':>24}"]
    for name in ("verdict", "ended_by", *Figures._fields, *COUNTS):
        stored = "-" if made.stored is None else _text(made.stored[name])
        virtual = _text(made.nodes[name]) if name in made.nodes else "-"
        mark = "  DIFFERS" if name in made.differences else ""
        lines.append(f"{name:22}{stored:>24}{virtual:>24}{mark}")
    return lines


def _text(value: Any) -> str:
    return repr(value) if isinstance(value, float) else str(value)
