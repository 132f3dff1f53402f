"""One soak of real processes: the pair settles, a babbling node starts, then stops again."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from steer_by_wire.closed_loop.pair.pair_result import CONTROLLER_PROGRAM, PLANT_PROGRAM
from steer_by_wire.closed_loop.pair.virtual_bus import QUIET_BUS
from steer_by_wire.closed_loop.processes.process_group import ProcessError
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.settings.toml_text import dump_toml
from steer_by_wire.tools.faults.live.recorded_pair import CHANNEL, LiveSetup, Running, run_live
from tests.soak.soak_logs import BusLog, Frames, read_bus_log, read_own_log

BABBLER = "babbler"
SETTLE_S = 0.5
"""How long the pair runs before the babbling, and after it."""
_ANY_OVERRUNS = [
    *("--set", 'overruns.overruns_max="off"'),
    *("--set", 'overruns.missed_periods_max="off"'),
]
"""Without real-time priority, periods missed on a busy machine are no finding about the pair."""


class LiveSoak(NamedTuple):
    """Result of a run.

    ``sent``, ``taken``  by the recordings of the two nodes
    ``memory_kib``       resident memory of each process by its name: time [s], memory [KiB]
    ``reports``          of all processes, by their names
    ``cut_off``        why the recording of the bus ends before the run, empty if it does not
    """

    bus: BusLog
    sent: Frames
    taken: Frames
    memory_kib: Mapping[str, Sequence[tuple[float, int]]]
    reports: Mapping[str, Any]
    cut_off: str


def run_live_soak(
    babble_ids: Sequence[int], babble_s: float, folder: Path, bus: BusSettings = QUIET_BUS
) -> LiveSoak:
    """Run it and read the files that it left in ``folder``; raises ProcessError."""
    memory_kib: dict[str, list[tuple[float, int]]] = {}

    def disturb(running: Running) -> Sequence[str]:
        time.sleep(SETTLE_S)
        words = [running.others.address, CHANNEL, str(folder / f"{BABBLER}.json")]
        running.others.start(BABBLER, "tests.soak.babbling_node", [*words, *map(str, babble_ids)])
        start_s = time.monotonic()
        while (elapsed_s := time.monotonic() - start_s) < babble_s:
            running.others.check()
            running.pair.programs.check()
            for name, pid in running.pids().items():
                memory_kib.setdefault(name, []).append((elapsed_s, resident_kib(pid)))
            time.sleep(min(1.0, babble_s / 10.0))
        running.others.end(BABBLER)
        time.sleep(SETTLE_S)
        return [BABBLER]

    bus_file = folder / "bus.toml"
    bus_file.write_text(dump_toml(bus), encoding="utf-8")
    setup = LiveSetup(["--bus-settings", str(bus_file)], _ANY_OVERRUNS)
    run = run_live(folder, setup, disturb)
    for name, status in run.statuses.items():
        if status:
            raise ProcessError(f"{name} has ended with status {status}: {run.folder / name}.txt")
    bus_log = read_bus_log(run.bus_log, babble_ids)
    (sent, taken), (plant_sent, plant_taken) = (
        read_own_log(run.own_log(name)) for name in (CONTROLLER_PROGRAM, PLANT_PROGRAM)
    )
    both_sent, both_taken = {**sent, **plant_sent}, {**taken, **plant_taken}
    return LiveSoak(bus_log, both_sent, both_taken, memory_kib, run.reports, run.cut_off)


def resident_kib(pid: int) -> int:
    """Return the resident memory of a process that runs [KiB]. Linux only."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS:"))
