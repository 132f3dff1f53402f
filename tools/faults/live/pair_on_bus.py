"""One soak of real processes: the pair settles, the babbling node starts, then stops again.

Memory of the processes is watched over the run: at its start, middle and end, and whether it grows.
"""

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ....closed_loop.processes import Processes
from ....closed_loop.virtual_bus import QUIET_BUS
from ....runtime.bus_model.settings import BusSettings
from ....runtime.settings.toml_text import dump_toml
from . import census

GROWTH_KIB_MAX = 512
"""Growth over half a run that still counts as flat: the bins of statistics, one at a time, and
pages that an allocator touches late."""
WARM_UP = 0.5
"""Share of the run after which growth is measured. Buffers grow with the longest stall so far, in
steps; a leak grows in the second half of a run as in the first."""


class MemoryFigures(NamedTuple):
    """Resident memory of one process [KiB].

    ``slope_kib_min``  of the straight line through the samples after the warm-up [KiB/min]
    ``growth_kib``     of that line, from the end of the warm-up to the end [KiB]
    ``is_flat``        whether it grew by no more than GROWTH_KIB_MAX
    """

    start_kib: int
    middle_kib: int
    end_kib: int
    slope_kib_min: float
    growth_kib: float
    is_flat: bool


class MemoryWatch:
    """Samples the memory of processes, by their names.

    ``samples``  time [s] and resident memory [KiB]
    """

    def __init__(self, processes: Mapping[str, int]) -> None:
        self._processes = processes
        self.samples: dict[str, list[tuple[float, int]]] = {name: [] for name in processes}

    def sample(self, time_s: float) -> None:
        """Take a sample of every process that still runs, at ``time_s`` since the start."""
        for name, pid in self._processes.items():
            kib = resident_kib(pid)
            if kib is not None:
                self.samples[name].append((time_s, kib))

    def figures(self) -> dict[str, MemoryFigures]:
        """Return the figures of every process that was seen."""
        return {name: figures_of(samples) for name, samples in self.samples.items() if samples}


def figures_of(samples: Sequence[tuple[float, int]]) -> MemoryFigures:
    """Return the figures of samples in order: time [s] and resident memory [KiB], at least one."""
    first, middle, last = samples[0], samples[len(samples) // 2], samples[-1]
    warm_s = first[0] + WARM_UP * (last[0] - first[0])
    rest = [sample for sample in samples if sample[0] >= warm_s]
    mean_s = sum(time_s for time_s, _ in rest) / len(rest)
    mean_kib = sum(kib for _, kib in rest) / len(rest)
    spread = sum((time_s - mean_s) ** 2 for time_s, _ in rest)
    slope = sum((time_s - mean_s) * (kib - mean_kib) for time_s, kib in rest)
    slope_kib_s = slope / spread if spread else 0.0
    growth_kib = slope_kib_s * (last[0] - rest[0][0])
    return MemoryFigures(
        first[1], middle[1], last[1], 60.0 * slope_kib_s, growth_kib, growth_kib <= GROWTH_KIB_MAX
    )


def resident_kib(pid: int) -> int | None:
    """Return the resident memory of a process [KiB]; None when it is gone. Linux only."""
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return None
    found = [line.split()[1] for line in status.splitlines() if line.startswith("VmRSS:")]
    return int(found[0]) if found else None


CHANNEL = "can0"
SAMPLES = 600
"""Samples of memory over a run, one a second at most."""
CONTROLLER, PLANT = "steering-controller", "plant-emulator"
_BEAR_OVERRUNS = 'overruns.overruns_max="off"'
_BEAR_MISSED_PERIODS = 'overruns.missed_periods_max="off"'


class Plan(NamedTuple):
    """Settings of a soak.

    ``babble_ids`` identifiers of the babbling node
    ``babble_s``   how long it babbles; the pair runs ``settle_s`` before and ``recover_s`` after it
    ``bus``        its bit rate and other traffic
    ``priority``   SCHED_FIFO of broker and pair, 0 for none; recorder and babbler get half
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

    ``modes``    when the controller's commands changed mode after the onset [s]; which; steer
    ``reports``  of all processes, by their names
    """

    plan: Plan
    bus: census.BusLog
    messages: list[census.MessageCount]
    modes: list[tuple[float, str, float]]
    memory: Mapping[str, MemoryFigures]
    memory_samples: Mapping[str, Sequence[tuple[float, int]]]
    reports: Mapping[str, Any]


def run_live_soak(
    plan: Plan, folder: Path, report: Callable[[str], None] = lambda _line: None
) -> LiveSoak:
    """Run it and read the files that it left in ``folder``; raises ProcessError."""
    folder.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory(prefix="soak-") as private,
        Processes(folder, Path(private)) as programs,
    ):
        report("starting broker, recorder, plant and controller")
        _start(programs, plan, Path(private) / "socket")
        time.sleep(plan.settle_s)
        report(f"babbling with {plan.name} for {plan.babble_s:g} s")
        _start_babbler(programs, plan)
        watch = MemoryWatch(programs.pids())
        _wait(programs, watch, plan.babble_s)
        reports = {"babbler": programs.stop("babbler")}
        time.sleep(plan.recover_s)
        # The controller first: without a plant it would hold, which is not to be tested here.
        for name in (CONTROLLER, PLANT, "recorder", "broker"):
            reports[name] = programs.stop(name)
        report("reading the logs")
        bitrate_bit_s = plan.bus.bitrate_bit_s
        bus = census.read_bus_log(programs.path("bus", ".log"), plan.babble_ids, bitrate_bit_s)
        own_logs = [programs.path(name, ".log") for name in (CONTROLLER, PLANT)]
        messages = census.count_messages(bus, own_logs, bitrate_bit_s)
        sent, _ = census.read_own_log(own_logs[0])
        modes = [
            ((time_ns - bus.babble_ns[0]) * 1e-9, mode.name, steer_rad)
            for time_ns, mode, steer_rad in census.mode_changes(sent)
        ]
    return LiveSoak(plan, bus, messages, modes, watch.figures(), watch.samples, reports)


def _start(programs: Processes, plan: Plan, socket: Path) -> None:
    """Start all but the babbling node; the recorder before any node sends."""
    priority = str(plan.priority)
    settings = programs.path("bus", ".toml")
    settings.write_text(dump_toml(plan.bus), encoding="utf-8")
    programs.start_broker(socket, ["--bus-settings", str(settings), "--priority", priority])
    address = programs.address
    bus_log = str(programs.path("bus", ".log"))
    report = str(programs.path("recorder", ".json"))
    arguments = [address, CHANNEL, bus_log, report, str(plan.priority // 2)]
    programs.start("recorder", "steer_by_wire.tools.faults.live.recorder", arguments)
    seconds = plan.settle_s + plan.babble_s + plan.recover_s
    # Without real-time priority, periods missed on a busy machine are no finding about the pair.
    bear = [] if plan.priority else ["--set", _BEAR_OVERRUNS, "--set", _BEAR_MISSED_PERIODS]
    own = {
        PLANT: ("steer_by_wire.plant_emulator", ["--set", f"duration_s={seconds + 3600.0:g}"]),
        CONTROLLER: ("steer_by_wire.controller", ["--preset", "practical_pd_ddob"]),
    }
    bus = ["-i", "emulated", "-c", CHANNEL, "--bus-kwargs", f"address={address}"]
    for name, (module, options) in own.items():
        files = ["--report", programs.path(name, ".json"), "--record", programs.path(name, ".log")]
        arguments = [*bus, *map(str, files), "--priority", priority, *bear, *options]
        programs.start(name, module, arguments)


def _start_babbler(programs: Processes, plan: Plan) -> None:
    report = str(programs.path("babbler", ".json"))
    arguments = [programs.address, CHANNEL, report, str(plan.priority // 2)]
    arguments += map(str, plan.babble_ids)
    programs.start("babbler", "steer_by_wire.tools.faults.injection.babbler", arguments)


def _wait(programs: Processes, watch: MemoryWatch, duration_s: float) -> None:
    start_s = time.monotonic()
    period_s = max(duration_s / SAMPLES, min(1.0, duration_s / 10.0))
    index = 0
    while (elapsed_s := time.monotonic() - start_s) < duration_s:
        programs.check()
        watch.sample(elapsed_s)
        index += 1
        time.sleep(max(0.0, min(index * period_s, duration_s) - (time.monotonic() - start_s)))
    programs.check()
    watch.sample(duration_s)
