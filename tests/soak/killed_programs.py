"""Kill the broker or the cockpit (-9) at drawn times, and judge what is left.

    python -m tests.soak.killed_programs [--tries 10] [--seed 1]

The promise:

    the broker     both nodes end with status 3 and one line; each recording has the frames that its
                   report counts; a broker starts again at the same address
    the cockpit    none of the processes that it has started is left; the same command starts again

Prints what breaks it, and the count of tries. Takes about ten seconds a try.
"""

import argparse
import json
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from steer_by_wire.closed_loop.pair.live_bus import Bus
from steer_by_wire.closed_loop.pair.live_pair import PROGRAMS, LivePair
from steer_by_wire.closed_loop.pair.pair_result import PairFiles
from steer_by_wire.closed_loop.processes.private_folder import private_folder
from steer_by_wire.closed_loop.processes.process_group import ProcessError, Processes, children_of
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.exit_status import ExitStatus
from tests.soak.full_disk import readable

BROKER = "broker"
LATEST_S = 3.0
"""After all are ready; half of the kills come sooner."""
PATIENCE_S = 30.0
COCKPIT = ("-m", "steer_by_wire.tools.cockpit", "--no-browser", "--bus", "emulated")


def kill_broker(after_s: float) -> Iterator[str]:
    """Kill a broker so long after its pair is ready, or while it starts; yields what is broken."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        socket = stack.enter_context(private_folder("kills")) / "socket"
        others = stack.enter_context(Processes(folder))
        others.start_broker(socket, ())
        bus = Bus("emulated", "can0", {"address": others.address})
        files = PairFiles(folder)
        files.write_settings(PlantSettings(duration_s=600.0), controller_preset("practical_pd"))
        options = {name: ["--record", str(folder / f"{name}.log")] for name in PROGRAMS}
        pair = stack.enter_context(LivePair(bus, files, options=options, is_recorded=False))
        if after_s >= 0.0:
            pair.wait_until_ready()
        time.sleep(after_s % LATEST_S)
        others.kill([BROKER])
        for name in PROGRAMS:
            is_over = within_patience(partial(has_ended, pair, name))
            status = pair.programs.status(name)
            said = pair.programs.path(name, ".txt").read_text("utf-8", "replace")
            errors = [line for line in said.splitlines() if ": error: " in line]
            if not is_over or status != ExitStatus.BUS or len(errors) != 1 or "Traceback" in said:
                yield f"{name}: status {status}: {said}"
            log = folder / f"{name}.log"
            if log.exists() and files.report(name).exists():
                counted = recorded_frames(files.report(name))
                if readable(log) < counted:
                    yield f"{name}: {readable(log)} of {counted} frames are in its recording"
        try:
            others.start_broker(socket, ())
        except ProcessError as error:
            yield f"the broker does not start again: {error}"


def kill_cockpit(after_s: float) -> Iterator[str]:
    """Kill a cockpit so long after it is ready, or while it starts; yields what is broken."""
    for is_killed in (True, False):
        with subprocess.Popen([sys.executable, *COCKPIT], stdout=subprocess.PIPE) as cockpit:
            assert cockpit.stdout is not None
            if after_s >= 0.0 or not is_killed:
                line = cockpit.stdout.readline().decode()
                if "http://" not in line:
                    yield f"does not start: {line}"
            time.sleep(after_s % LATEST_S if is_killed else 0.0)
            started = descendants_of(cockpit.pid)
            cockpit.send_signal(signal.SIGKILL if is_killed else signal.SIGTERM)
        if not within_patience(partial(none_exists, started)):
            yield f"left: {[one for one in started if exists(one)]}"


def recorded_frames(report: Path) -> int:
    """Return how many frames a node's report counts in its recording."""
    return int(json.loads(report.read_text("utf-8"))["recording"]["frames"])


def descendants_of(pid: int) -> list[int]:
    """Return the processes that one has started, and theirs."""
    return [one for child in children_of(pid) for one in (child, *descendants_of(child))]


def has_ended(pair: LivePair, name: str) -> bool:
    """Whether a program of the pair has ended."""
    return pair.programs.status(name) is not None


def none_exists(pids: Sequence[int]) -> bool:
    """Whether all processes are gone."""
    return not any(map(exists, pids))


def exists(pid: int) -> bool:
    """Whether a process is there."""
    return Path(f"/proc/{pid}").exists()


def within_patience(is_so: Callable[[], bool]) -> bool:
    """Wait for something; returns whether it has come."""
    until_s = time.monotonic() + PATIENCE_S
    while not is_so():
        if time.monotonic() > until_s:
            return False
        time.sleep(0.05)
    return True


def main() -> int:
    """Run the search."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.killed_programs")
    parser.add_argument("--tries", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    draw, broken = random.Random(asked.seed), 0
    for kill in (kill_broker, kill_cockpit):
        for _ in range(asked.tries):
            after_s = draw.uniform(-LATEST_S, LATEST_S)
            for text in kill(after_s):
                broken += 1
                print(f"{kill.__name__} after {after_s:.3f} s: {text}", flush=True)  # noqa: T201
        print(f"{kill.__name__}: {asked.tries} tries, {broken} promises broken", flush=True)  # noqa: T201
    return bool(broken)


if __name__ == "__main__":
    sys.exit(main())
