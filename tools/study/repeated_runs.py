"""One run of a study, repeated with the nodes in virtual time.

The nodes run on a wire that takes no time, as the compiled run does. Their figures are computed
from their samples and commands, and every figure must equal the stored one, to the last digit. A
run of a study with a bus is repeated on that bus.
"""

import math
import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...closed_loop.pair.pair_result import BUS, PairFiles
from ...closed_loop.studies.compiled_figures import COLUMNS, COUNTS, Figures, verdict_of
from ...closed_loop.studies.compiled_runs import Computer
from ...closed_loop.studies.node_runs import run_on_nodes
from ...closed_loop.studies.result_files import Store
from ...closed_loop.studies.scenario import Pair
from ...dbc.bus_language import read_language
from ...plant_emulator.evaluation.run_verdict import RunEnd, VerdictRules, end_of
from ...runtime.array_types import FloatArray
from ...runtime.settings import SettingsError


class Replay(NamedTuple):
    """One repeated run.

    ``stored``    the row; None where the study has not reached it yet
    ``expected``  what the nodes have to reproduce: the row, or the figures of a new run
    ``nodes``     figures of the nodes; without counts where the run ended early
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
    study = computer.scenarios.study
    rules = study.settings.verdict
    if not 0 <= run < study.runs:
        raise SettingsError(f"--replay {run}: the study has runs 0 to {study.runs - 1}")
    pair = computer.scenarios.pair(run)
    files = PairFiles(store.folder / "replay" / str(run))
    others = [*read_language(pair.dialect).files, *map(Path, pair.command)]
    files.write_settings(pair.plant, pair.controller, pair.bus, others)
    stored = store.find(run)
    expected = stored or _row(rules, lambda row: computer.run(pair, row))
    is_whole = expected["ended_by"] == RunEnd.COMPLETE
    commands_max = None if is_whole or pair.bus else expected["commands_sent"]
    nodes = _row(rules, lambda row: run_on_nodes(pair, pair.bus, rules, row, commands_max))
    if not is_whole:  # a compiled run ends where the nodes go on
        nodes = {name: value for name, value in nodes.items() if name not in COUNTS}
    return Replay(pair, files, stored, expected, nodes)


def _row(rules: VerdictRules, run: Callable[[FloatArray], RunEnd]) -> dict[str, Any]:
    """Return what a study stores of a run that writes its figures into a row."""
    row = np.full(len(COLUMNS), np.nan)
    end = run(row)
    end = end_of(end, row[COLUMNS.index("duration_s")])
    values: dict[str, Any] = dict(zip(COLUMNS, row.tolist(), strict=True))
    values |= {name: int(values[name]) for name in COUNTS}
    return {"ended_by": str(end), **values, "verdict": str(verdict_of(rules, end, row))}


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
