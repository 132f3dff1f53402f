"""One run of the live campaign: a pair on an emulated bus, and one fault."""

import secrets
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ....closed_loop.processes.private_folder import private_folder
from ....dbc.messages import CAN_IDS, SteeringCommand
from ....plant_emulator.settings import PlantSettings
from .cases import DURATION_S, ONSET_S, PLANT_ONSET_S, LiveCase
from .recorded_pair import DURATION_S as MOTION_S
from .recorded_pair import LiveRun, LiveSetup, Running, run_live

SETTLE_S, RECOVER_S = 1.5, 2.0
INJECTOR = "injector"
_KEY_BYTES = 16
_DATA_BITRATE_BIT_S = 2_000_000
_COMMAND = f" {CAN_IDS[SteeringCommand]:03X}#"


class Trial(NamedTuple):
    """A case and its run.

    ``observed``   wall clock from which the fault is expected, and when the run was ended [ns]
    """

    case: LiveCase
    run: LiveRun
    observed: tuple[int, int]

    @property
    def actions(self) -> Sequence[Mapping[str, Any]]:
        """What the injector did: wall clock [ns], fault, what."""
        actions: Sequence[Mapping[str, Any]] = self.run.reports.get(INJECTOR, {}).get("actions", [])
        return actions


def run_trial(case: LiveCase, folder: Path, seed: int, recording: Path) -> Trial:
    """Run one case; raises ProcessError when a process does not start or does not end.

    ``recording``  what a replay sends
    """
    begin_ns = end_ns = 0

    def inject(running: Running) -> Sequence[str]:
        nonlocal begin_ns, end_ns
        time.sleep(SETTLE_S)
        begin_ns = time.time_ns()
        if case.inject:
            options = _options(running, case, seed, recording, folder / f"{INJECTOR}.json")
            running.others.start(INJECTOR, "steer_by_wire.tools.faults.injection.program", options)
        time.sleep(ONSET_S + DURATION_S + RECOVER_S)
        end_ns = time.time_ns()
        return [INJECTOR] if case.inject else []

    broker: list[str] = []
    both = ["--reconnect"] if case.reconnects else []
    with private_folder("key") as private:
        if case.with_key:
            key = private / "key"
            write_key(key)
            broker += ["--data-bitrate", str(_DATA_BITRATE_BIT_S)]
            both += ["--key-file", str(key)]
        setup = LiveSetup(broker, both, plant_settings(case), takes_fd=case.with_key)
        run = run_live(folder, setup, inject)
    return Trial(case, run, (begin_ns, end_ns))


def write_excerpt(bus_log: Path, excerpt: Path) -> None:
    """Copy a recording of the bus from the first command on: from then both nodes take part."""
    lines = bus_log.read_text(encoding="ascii").splitlines(keepends=True)
    first = next((place for place, line in enumerate(lines) if _COMMAND in line), 0)
    excerpt.write_text("".join(lines[first:]), encoding="ascii")


def write_key(path: Path) -> None:
    """Write a new key that only its user may read."""
    path.touch(mode=0o600)
    path.write_text(secrets.token_hex(_KEY_BYTES) + "\n", encoding="ascii")


def plant_settings(case: LiveCase) -> PlantSettings:
    """Return the plant's settings, with the case's fault if it is one of the plant's."""
    if case.at_plant is None:
        return PlantSettings(duration_s=MOTION_S)
    times = {"onset_s": PLANT_ONSET_S, "duration_s": DURATION_S}
    return PlantSettings(duration_s=MOTION_S, faults=(case.at_plant.model_copy(update=times),))


def _options(
    running: Running, case: LiveCase, seed: int, recording: Path, report: Path
) -> list[str]:
    options = ["--seed", str(seed), "--json", str(report)]
    if case.targets:
        pids = running.pids()
        return [*(f"{case.argument},pid={pids[name]}" for name in case.targets), *options]
    return [case.argument, *options, "--recording", str(recording), *running.bus.options]
