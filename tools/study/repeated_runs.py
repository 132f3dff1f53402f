"""One run of a study: its settings as files, and the commands that run it again."""

import shlex
from pathlib import Path

from ...closed_loop.pair.pair_result import BUS, PairFiles
from ...closed_loop.studies.scenario import Pair, Scenarios
from ...dbc.bus_language import read_language
from ...runtime.settings import SettingsError


def write_settings(scenarios: Scenarios, run: int, folder: Path) -> list[str]:
    """Write the settings of run number ``run``; returns the commands that run it again.

    Raises SettingsError where there is none of this number.
    """
    runs = scenarios.study.runs
    if not 0 <= run < runs:
        raise SettingsError(f"--replay {run}: the study has runs 0 to {runs - 1}")
    pair, files = scenarios.pair(run), PairFiles(folder / "replay" / str(run))
    others = [*read_language(pair.dialect).files, *map(Path, pair.command)]
    files.write_settings(pair.plant, pair.controller, pair.bus, others)
    return _commands(pair, files)


def _commands(pair: Pair, files: PairFiles) -> list[str]:
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
