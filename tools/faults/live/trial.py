"""One run of the live campaign: broker, recorder, plant, controller, then one fault."""

import json
import secrets
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ....closed_loop.processes import Processes
from ....dbc.messages import CAN_IDS, SteeringCommand
from .cases import CONTROLLER, DURATION_S, ONSET_S, PLANT, PLANT_ONSET_S, LiveCase

CHANNEL = "can0"
SETTLE_S, RECOVER_S = 1.5, 2.0
GONE_TIMEOUT_S = 5.0
"""Time that the file-writing processes of the programs may need to end after them."""
_INJECTOR, _RECORDER, _BROKER = "injector", "recorder", "broker"
_RUN_S = 600.0
_KEY_BYTES = 16
_DATA_BITRATE_BIT_S = 2_000_000
_COMMAND = f" {CAN_IDS[SteeringCommand]:03X}#"


class Trial(NamedTuple):
    """Files and figures of a run.

    ``statuses``   exit status by process; -9 for SIGKILL
    ``reports``    of the programs that have written one
    ``actions``    what the injector did: wall clock [ns], fault, what
    ``observed``   wall clock from which the fault is expected, and when the run was ended [ns]
    ``left``       processes and files that should have gone
    """

    case: LiveCase
    folder: Path
    statuses: Mapping[str, int]
    reports: Mapping[str, Any]
    actions: Sequence[Mapping[str, Any]]
    observed: tuple[int, int]
    left: Sequence[str]

    @property
    def bus_log(self) -> Path:
        """Everything that was on the bus, with its time stamps."""
        return self.folder / "bus.log"

    def own_log(self, program: str) -> Path:
        """Frames that one program sent and received."""
        return self.folder / f"{program}.log"


def run_trial(case: LiveCase, folder: Path, seed: int, recording: Path) -> Trial:
    """Run one case; raises ProcessError when a process does not start or does not end.

    ``recording``  what a replay sends
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.iterdir():
        if old.suffix in (".log", ".json", ".txt"):
            old.unlink()
    with (
        tempfile.TemporaryDirectory(prefix="campaign-") as private,
        Processes(folder, Path(private)) as programs,
    ):
        socket, key = Path(private) / "socket", Path(private) / "key"
        if case.with_key:
            write_key(key)
        _start_pair(programs, socket, case, key)
        time.sleep(SETTLE_S)
        begin_ns = time.time_ns()
        if case.fault:
            options = _options(programs, case, seed, recording)
            programs.start(_INJECTOR, "steer_by_wire.tools.faults.injection.program", options)
        time.sleep(ONSET_S + DURATION_S + RECOVER_S)
        end_ns = time.time_ns()
        pids = programs.pids()
        statuses = {_INJECTOR: programs.end(_INJECTOR)} if case.fault else {}
        # Both together: either would enter its hold if the other ended first.
        for name in (PLANT, CONTROLLER):
            programs.interrupt(name)
        for name in (CONTROLLER, PLANT, _RECORDER, _BROKER):
            statuses[name] = programs.end(name)
        left = _still_there(pids)
        left += [socket.name] if socket.exists() else []
    reports = {
        name: json.loads(path.read_text(encoding="utf-8"))
        for name in (PLANT, CONTROLLER, _INJECTOR)
        if (path := folder / f"{name}.json").exists()
    }
    actions = reports.get(_INJECTOR, {}).get("actions", [])
    return Trial(case, folder, statuses, reports, actions, (begin_ns, end_ns), left)


def write_excerpt(bus_log: Path, excerpt: Path) -> None:
    """Copy a recording of the bus from the first command on: from then both nodes take part."""
    lines = bus_log.read_text(encoding="ascii").splitlines(keepends=True)
    first = next((place for place, line in enumerate(lines) if _COMMAND in line), 0)
    excerpt.write_text("".join(lines[first:]), encoding="ascii")


def write_key(path: Path) -> None:
    """Write a new key that only its user may read."""
    path.touch(mode=0o600)
    path.write_text(secrets.token_hex(_KEY_BYTES) + "\n", encoding="ascii")


def _start_pair(programs: Processes, socket: Path, case: LiveCase, key: Path) -> None:
    """Start all but the injector; the recorder before any node sends."""
    broker = ["--allow-bus-off"]
    broker += ["--data-bitrate", str(_DATA_BITRATE_BIT_S)] if case.with_key else []
    programs.start_broker(socket, broker)
    recorder = [programs.path("bus", ".log"), programs.path(_RECORDER, ".json")]
    arguments = [programs.address, CHANNEL, *map(str, recorder), "0"]
    arguments += ["fd"] if case.with_key else []
    programs.start(_RECORDER, "steer_by_wire.tools.faults.live.recorder", arguments)
    plant = ["--set", f"duration_s={_RUN_S:g}"]
    if case.at_plant:
        settings = programs.path(PLANT, ".toml")
        settings.write_text(plant_settings(case), encoding="utf-8")
        plant = [str(settings), *plant]
    own = {
        PLANT: ("steer_by_wire.plant_emulator", plant),
        CONTROLLER: ("steer_by_wire.controller", ["--preset", "practical_pd_ddob"]),
    }
    for name, (module, options) in own.items():
        files = ["--report", programs.path(name, ".json"), "--record", programs.path(name, ".log")]
        files += ["--key-file", key] if case.with_key else []
        options += ["--reconnect"] if case.reconnects else []
        # Settings first: after --bus-kwargs they would be parsed as more of its arguments.
        programs.start(name, module, [*options, *map(str, files), *_bus_options(programs)])


def plant_settings(case: LiveCase) -> str:
    """Return the plant's settings file with the case's fault."""
    table = {**case.at_plant, "onset_s": PLANT_ONSET_S, "duration_s": DURATION_S}
    return "[[faults]]\n" + "".join(f"{key} = {json.dumps(one)}\n" for key, one in table.items())


def _options(programs: Processes, case: LiveCase, seed: int, recording: Path) -> list[str]:
    options = ["--seed", str(seed), "--report", str(programs.path(_INJECTOR, ".json"))]
    if case.targets:
        pids = programs.pids()
        return [*(f"{case.argument},pid={pids[name]}" for name in case.targets), *options]
    return [case.argument, *options, "--recording", str(recording), *_bus_options(programs)]


def _bus_options(programs: Processes) -> list[str]:
    return ["-i", "emulated", "-c", CHANNEL, "--bus-kwargs", f"address={programs.address}"]


def _still_there(pids: Mapping[str, int]) -> list[str]:
    """Return which processes still exist after a while."""
    until_s = time.monotonic() + GONE_TIMEOUT_S
    while True:
        left = [f"process {name}" for name, pid in pids.items() if Path(f"/proc/{pid}").exists()]
        if not left or time.monotonic() > until_s:
            return left
        time.sleep(0.05)
