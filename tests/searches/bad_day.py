"""A bad day: damaged files, programs that are killed or starved, and clocks that jump.

    python -m tests.searches.bad_day [files | programs | clocks] [--cases 200] [--seed 1]
    tools/with_vcan python -m tests.searches.bad_day clocks --bus socketcan

    files      drawn databases and settings with drawn damage: one line, or what they hold
    programs   killed, or with too little memory or disk: a status of theirs, no traceback, and
               the next run is whole
    clocks     the wall clock jumps by an hour, forth and back, under both programs: they go on
               exchanging frames as their twins with a still clock do

Prints each case that ends in a traceback, in a signal that was not sent, over 60 s of processor
time or 500 MB, and the counts; ends with status 1 if there is one.
"""

import argparse
import importlib
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
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random

from tests.support.programs.running_program import ORDINARY, UNSUPERVISED

CPU_S_MAX, MEMORY_KB_MAX, WALL_S_MAX = 60.0, 500_000, 300.0
ROOT = Path(__file__).resolve().parents[2]
NUMBERS = ("0", "-1", "99999999", "1e999", "nan", "-0.5", "4294967296", "9" * 400, "0x7F", "")
MONSTERS = ("a" + ".a" * 20_000 + " = 1\n", "[" * 5_000, "\0", "\ufeff", '"' * 3, "{" * 200, "é;")
PROGRAMS = {
    ".dbc": (("tools.can", "response-times"), ("tools.dialect", "new")),
    ".toml": (("controller", "--check"), ("tools.run", "--duration=0.2")),
}
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


def damaged(rng: Random, text: str) -> str:
    """Return a text with one to six pieces of damage."""
    for _ in range(rng.randint(1, 6)):
        lines = text.splitlines(keepends=True) or [""]
        at = rng.randrange(len(lines))
        kind = rng.randrange(7)
        if kind == 0:  # a number
            places = [found.span() for found in re.finditer(r"-?\d+(\.\d+)?", text)]
            first, last = rng.choice(places or [(0, 0)])
            text = text[:first] + rng.choice(NUMBERS) + text[last:]
            continue
        if kind == 1:
            lines[at] = lines[at][: rng.randint(0, len(lines[at]))]
        elif kind == 2:
            lines.insert(at, rng.choice(lines))
        elif kind == 3:
            del lines[at : at + rng.randint(1, 3)]
        elif kind == 4:
            lines.insert(at, rng.choice(MONSTERS))
        elif kind == 5:
            place = rng.randint(0, len(lines[at]))
            lines[at] = lines[at][:place] + rng.choice(' "\t;:@|[]{}=.,Zé\x7f') + lines[at][place:]
        else:
            lines = lines[: max(at, 1)]
        text = "".join(lines)
    return text


def forked(run: Callable[[], int], said: Path) -> tuple[int, float, int]:
    """Run in a child; returns its status (-9: too long), processor time [s], memory [KB]."""
    child = os.fork()
    if not child:
        with said.open("wb") as stream:
            for number in (1, 2):
                os.dup2(stream.fileno(), number)
        status = 70
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (round(CPU_S_MAX) + 1,) * 2)
            status = run()
        except SystemExit as end:
            status = int(end.code or 0)
        finally:
            sys.excepthook(*sys.exc_info()) if sys.exc_info()[0] and status == 70 else None
            sys.stdout.flush()
            os._exit(status)
    _, ended, used = os.wait4(child, 0)
    return os.waitstatus_to_exitcode(ended), used.ru_utime + used.ru_stime, used.ru_maxrss


def files(cases: int, rng: Random, counts: Counts, folder: Path) -> list[str]:
    """Read drawn files; returns the failures."""
    bases = {
        ".dbc": [ROOT / "dbc" / "steer_by_wire.dbc"],
        ".toml": [*ROOT.glob("plant_emulator/presets/*.toml"), *ROOT.glob("controller/presets/*")],
    }
    failures = []
    for suffix, programs in PROGRAMS.items():
        mains = [importlib.import_module(f"steer_by_wire.{name}.__main__") for name, _ in programs]
        texts = [file.read_text() for file in bases[suffix] if file.suffix == suffix]
        for case in range(cases):
            file = folder / f"drawn{case}{suffix}"
            file.write_text(damaged(rng, rng.choice(texts)))
            main, (name, word) = rng.choice([*zip(mains, programs, strict=True)])
            words = [word, str(file)]
            status, cpu_s, memory_kb = forked(lambda m=main, w=words: m.main(w), folder / "said")
            said = (folder / "said").read_text(errors="replace")
            counts[f"{suffix} status {status}"] += 1
            counts[f"{suffix} most MB"] = max(counts[f"{suffix} most MB"], memory_kb // 1000)
            counts[f"{suffix} most s"] = max(counts[f"{suffix} most s"], round(cpu_s))
            is_sound = status in (0, 2, 4) and "Traceback" not in said
            if not is_sound or cpu_s > CPU_S_MAX or memory_kb > MEMORY_KB_MAX:
                kept = Path(tempfile.gettempdir()) / f"bad_day_{case}{suffix}"
                kept.write_bytes(file.read_bytes())
                last = said.strip().splitlines()[-1:]
                failures.append(
                    f"{name} {word} {kept}: {status}, {cpu_s:.0f} s, {memory_kb} KB {last}"
                )
    return failures


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
    parser.add_argument("parts", nargs="*", metavar="PART", help="files, programs, clocks; all")
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--bus", action="append", help="emulated, udp_multicast, socketcan")
    options = parser.parse_args()
    counts, failures = Counts(), list[str]()
    with tempfile.TemporaryDirectory() as name:
        for part in options.parts or ("files", "programs", "clocks"):
            if part == "clocks":
                buses = options.bus or ["emulated", "udp_multicast"]
                failures += clocks(buses, counts, Path(name))
            else:
                search = {"files": files, "programs": programs}[part]
                failures += search(options.cases, Random(options.seed), counts, Path(name))
    lines = [*failures, str(dict(sorted(counts.items()))), f"{len(failures)} broken"]
    sys.stdout.write("\n".join(lines) + "\n")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
