"""One soak of real processes: the pair settles, a babbling node starts, then stops again."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from steer_by_wire.closed_loop.pair_result import CONTROLLER, PLANT
from steer_by_wire.closed_loop.processes import ProcessError
from steer_by_wire.closed_loop.virtual_bus import QUIET_BUS
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.settings.toml_text import dump_toml
from steer_by_wire.tools.faults.live.live_run import (
    CHANNEL,
    LiveSetup,
    Running,
    run_live,
)
from tests.soak import frame_balance
from tests.soak.memory_growth import MemoryFigures, MemoryWatch

BABBLER = "babbler"
SAMPLES = 600
"""Samples of memory over a run, one a second at most."""
_ANY_OVERRUNS = (
    "--set",
    'overruns.overruns_max="off"',
    "--set",
    'overruns.missed_periods_max="off"',
)
"""Without real-time priority, periods missed on a busy machine are no finding about the pair."""


class SoakSettings(NamedTuple):
    """Settings of a soak.

    ``babble_ids`` identifiers of the babbling node
    ``babble_s``   how long it babbles; the pair runs ``settle_s`` before and ``recover_s`` after it
    ``bus``        its bit rate and rest bus
    ``priority``   SCHED_FIFO of broker and pair, 0 for none; the babbling node gets half
    """

    babble_ids: Sequence[int]
    babble_s: float
    settle_s: float = 2.0
    recover_s: float = 2.0
    bus: BusSettings = QUIET_BUS
    priority: int = 50

    @property
    def name(self) -> str:
        """The babbling node's identifiers."""
        return f"identifiers 0x{min(self.babble_ids):03X} to 0x{max(self.babble_ids):03X}"


class LiveSoak(NamedTuple):
    """Result of a run.

    ``modes``      when the controller's commands changed mode after the onset [s]; which; steer
    ``reports``    of all processes, by their names
    ``cut_short``  why the recording of the bus ends before the run, empty if it does not
    """

    settings: SoakSettings
    bus: frame_balance.BusLog
    messages: list[frame_balance.MessageBalance]
    modes: list[tuple[float, str, float]]
    memory: Mapping[str, MemoryFigures]
    memory_samples: Mapping[str, Sequence[tuple[float, int]]]
    reports: Mapping[str, Any]
    cut_short: str


def run_live_soak(
    soak: SoakSettings, folder: Path, report: Callable[[str], None] = lambda _line: None
) -> LiveSoak:
    """Run it and read the files that it left in ``folder``; raises ProcessError."""
    watch = MemoryWatch({})

    def babble(running: Running) -> Sequence[str]:
        nonlocal watch
        time.sleep(soak.settle_s)
        report(f"babbling with {soak.name} for {soak.babble_s:g} s")
        words = [running.others.address, CHANNEL, str(folder / f"{BABBLER}.json")]
        words += [str(soak.priority // 2), *map(str, soak.babble_ids)]
        running.others.start(BABBLER, "tests.soak.babbling_node", words)
        watch = MemoryWatch(running.pids())
        _wait(running, watch, soak.babble_s)
        running.others.end(BABBLER)
        time.sleep(soak.recover_s)
        return [BABBLER]

    folder.mkdir(parents=True, exist_ok=True)
    bus_file = folder / "bus.toml"
    bus_file.write_text(dump_toml(soak.bus), encoding="utf-8")
    priority = ["--priority", str(soak.priority)]
    both = priority if soak.priority else [*priority, *_ANY_OVERRUNS]
    report("starting broker, recorder, plant and controller")
    run = run_live(folder, LiveSetup(["--bus-settings", str(bus_file), *priority], both), babble)
    for name, status in run.statuses.items():
        if status:
            raise ProcessError(f"{name} has ended with status {status}: {run.folder / name}.txt")
    report("reading the logs")
    bitrate_bit_s = soak.bus.bitrate_bit_s
    bus = frame_balance.read_bus_log(run.bus_log, soak.babble_ids, bitrate_bit_s)
    own_logs = [run.own_log(name) for name in (CONTROLLER, PLANT)]
    messages = frame_balance.balance_messages(bus, own_logs, bitrate_bit_s)
    sent, _ = frame_balance.read_own_log(own_logs[0])
    modes = [
        ((time_ns - bus.babble_ns[0]) * 1e-9, mode.name, steer_rad)
        for time_ns, mode, steer_rad in frame_balance.mode_changes(sent)
    ]
    return LiveSoak(
        soak, bus, messages, modes, watch.figures(), watch.samples, run.reports, run.cut_short
    )


def _wait(running: Running, watch: MemoryWatch, duration_s: float) -> None:
    start_s = time.monotonic()
    period_s = max(duration_s / SAMPLES, min(1.0, duration_s / 10.0))
    index = 0
    while (elapsed_s := time.monotonic() - start_s) < duration_s:
        _check(running)
        watch.sample(elapsed_s)
        index += 1
        time.sleep(max(0.0, min(index * period_s, duration_s) - (time.monotonic() - start_s)))
    _check(running)
    watch.sample(duration_s)


def _check(running: Running) -> None:
    running.others.check()
    running.pair.programs.check()
