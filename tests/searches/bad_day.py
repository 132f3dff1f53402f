"""A bad day: programs that are killed or starved, and clocks that jump.

    python -m tests.searches.bad_day [programs | clocks] [--cases 200] [--seed 1]
    tools/with_vcan python -m tests.searches.bad_day clocks --bus socketcan

    programs   killed, or with too little memory or disk: a status of theirs, no traceback, and
               the next run is whole
    clocks     the wall clock jumps by an hour, forth and back, under both programs: they go on
               exchanging frames as their twins with a still clock do

Prints each case that ends in a traceback or in a signal that was not sent, and the counts; ends
with status 1 if there is one.
"""

import argparse
import json
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from random import Random

from tests.support.programs.running_program import ORDINARY, UNSUPERVISED

WALL_S_MAX = 300.0
ROOT = Path(__file__).resolve().parents[2]
COMMANDS = (
    "run --preset practical_pd --duration 2 --out OUT",
    "plant --preset paper_nominal -i virtual --duration 0.5 --json OUT.json --record OUT.log",
    "can response-times dbc/steer_by_wire.dbc",
    "study tests/searches/none.toml",
    "monitor -i virtual --duration 0.5",
)
JUMPING_CLOCK = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <sys/time.h>
#include <time.h>
int clock_gettime(clockid_t clock, struct timespec *now)
{
    static int (*real)(clockid_t, struct timespec *);
    struct timespec steady;
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int status = real(clock, now);
    if (clock == CLOCK_REALTIME) {
        real(CLOCK_MONOTONIC, &steady);
        now->tv_sec += 3600 * ((steady.tv_sec * 10 + steady.tv_nsec / 100000000) / 7 % 3 - 1);
    }
    return status;
}
time_t time(time_t *at)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    return at ? *at = now.tv_sec : now.tv_sec;
}
int gettimeofday(struct timeval *now, void *zone)
{
    struct timespec exact;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &exact);
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return 0;
}
"""
Counts = Counter[str]


def ended(
    command: str, limit: tuple[int, int] | None = None, after_s: float = 0.0, number: int = 0
) -> tuple[int, str]:
    """Run a command with a limit, or until a signal; returns its status and what it has said."""

    def limited() -> None:
        if limit is not None:
            resource.setrlimit(limit[0], (limit[1], limit[1]))

    words = [sys.executable, "-m", "steer_by_wire", *command.split()]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    process = subprocess.Popen(words, cwd=ROOT, preexec_fn=limited, **streams)
    if number:
        time.sleep(after_s)
        process.send_signal(number)
    try:
        said, _ = process.communicate(timeout=WALL_S_MAX)
    except subprocess.TimeoutExpired:
        process.kill()
        return -9, "too long"
    return process.returncode, said


def programs(cases: int, rng: Random, counts: Counts, folder: Path) -> list[str]:
    """Kill and starve programs; returns the failures."""
    failures = []
    for case in range(cases):
        kind = ("killed", "memory", "disk")[case % 3]
        command = rng.choice(COMMANDS).replace("OUT", str(folder / "out"))
        number = rng.choice((signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP))
        if kind == "killed":
            status, said = ended(command, None, rng.uniform(0.1, 5.0), number)
            allowed = {0, 2, 130, -number}
        elif kind == "memory":
            limit = rng.randrange(20, 500) << 20
            status, said = ended(command, (resource.RLIMIT_AS, limit))
            allowed = {0, 1, 2, 4} if "OpenBLAS" in said or "LLVM" in said else {0, 2, 4}
        else:
            limit = int(10 ** rng.uniform(1, 6))
            status, said = ended(command, (resource.RLIMIT_FSIZE, limit))
            allowed = {0, 2, 4}
        counts[f"{kind} status {status}"] += 1
        # Python itself has one for a Ctrl-C before it has read our first module.
        is_ours = "Traceback" in said and f"{ROOT}/" in said.replace(sys.prefix, "")
        if is_ours or (status not in allowed and "Traceback" not in said):
            what = f"{kind} {number if kind == 'killed' else limit}"
            failures.append(f"{command}: {what}: {status} {said.strip().splitlines()[-1:]}")
        for left in folder.glob("*.json"):
            json.loads(left.read_text())
        if case % 10 == 0 and ended(COMMANDS[0].replace("OUT", str(folder / "out")))[0]:
            failures.append(f"after {command} ({kind}) the next run is not whole")
    return failures


def pair(bus: Sequence[str], library: Path | None) -> tuple[list[int], list[int]]:
    """Return the exit statuses and the frames received of plant and controller."""
    environment = {**os.environ, **({"LD_PRELOAD": str(library)} if library else {})}
    common = [*bus, *ORDINARY, *UNSUPERVISED]
    words = {
        "plant": ["--preset", "paper_nominal", "--duration", "12"],
        "controller": ["--preset", "practical_pd", "--duration", "10"],
    }
    running = [
        subprocess.Popen(
            [sys.executable, "-m", "steer_by_wire", program, *own, *common],
            env=environment, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )
        for program, own in words.items()
    ]  # fmt: skip
    said = [process.communicate(timeout=WALL_S_MAX)[0] for process in running]
    received = [re.search(r"(\d+) frames received", text) for text in said]
    return (
        [process.returncode for process in running],
        [int(found[1]) if found else 0 for found in received],
    )


def clocks(buses: Sequence[str], counts: Counts, folder: Path) -> list[str]:
    """Let the wall clock jump; returns the failures."""
    source, library = folder / "clock.c", folder / "clock.so"
    source.write_text(JUMPING_CLOCK)
    build = ["gcc", "-shared", "-fPIC", "-O1", "-o", str(library), str(source), "-ldl"]
    subprocess.run(build, check=True)
    failures = []
    for bus in buses:
        socket = str(folder / "bus")
        options = {
            "emulated": ["-i", "emulated", "--bus-kwargs", f"address={socket}"],
            "udp_multicast": ["-i", "udp_multicast", "-c", "239.74.163.2"],
            "socketcan": ["-i", "socketcan", "-c", "vcan0"],
        }[bus]
        broker = None
        if bus == "emulated":
            words = [sys.executable, "-m", "steer_by_wire", "bus", "--address", socket]
            broker = subprocess.Popen(words, env={**os.environ, "LD_PRELOAD": str(library)})
            while not Path(socket).exists() and broker.poll() is None:
                time.sleep(0.1)
        still, jumping = pair(options, None), pair(options, library)
        if broker is not None:
            broker.terminate()
            broker.wait()
        for name, (statuses, received) in {"still": still, "jumping": jumping}.items():
            counts[f"{bus} {name} frames"] += sum(received)
            if any(statuses):
                failures.append(f"{bus}, {name} clock: statuses {statuses}")
        if sum(jumping[1]) < 0.5 * sum(still[1]) or not sum(still[1]):
            failures.append(f"{bus}: {jumping[1]} frames with a jumping clock, {still[1]} without")
    return failures


def main() -> int:
    """Run the parts; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help="programs, clocks; both")
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--bus", action="append", help="emulated, udp_multicast, socketcan")
    options = parser.parse_args()
    counts, failures = Counts(), list[str]()
    with tempfile.TemporaryDirectory() as name:
        for part in options.parts or ("programs", "clocks"):
            if part == "clocks":
                buses = options.bus or ["emulated", "udp_multicast"]
                failures += clocks(buses, counts, Path(name))
            else:
                failures += programs(options.cases, Random(options.seed), counts, Path(name))
    lines = [*failures, str(dict(sorted(counts.items()))), f"{len(failures)} broken"]
    sys.stdout.write("\n".join(lines) + "\n")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
