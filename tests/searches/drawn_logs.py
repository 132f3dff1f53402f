"""Analyse logs that are damaged by a draw, and judge what is said of them.

    python -m tests.searches.drawn_logs [--logs 500] [--seed 1]

The log is of a loop that holds its path, or of one that does not: thinned, doubled, cut, shuffled,
with a clock that is set or swapped neighbours, among foreign frames or the frames of another pair,
in any format of python-can. The promise:

    the program     ends with a result, or with one line that names the file; never a traceback
    counters        of frames that were taken away are missing, of doubled ones refused; no others
    foreign frames  as many as there are
    the verdict     "holds" neither of the loop that does not, nor of a shuffled log, nor of a log
                    without the messages of a pair

Prints what breaks it, and counts by kind of damage. Takes about two CPU minutes.
"""

import argparse
import gzip
import io
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from random import Random
from typing import Any, NamedTuple
from unittest.mock import patch

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import CAN_IDS, CYCLE_TIMES_MS, MESSAGE_TYPES
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.recording.candump import LogEntry, format_entry
from steer_by_wire.tools.analyze.__main__ import main as analyze
from tests.support.frames.recorded_frames import entries_in
from tests.support.runs.logged_run import convert

DURATION_S = 8.0
LOOPS = {
    True: ("latency.downlink.mean_s=0.05", "vehicle.speed_m_s=1.4"),
    False: ("latency.downlink.mean_s=0.7", "vehicle.speed_m_s=5.0"),
}
"""Plants, by whether they hold their path."""
DRAWS = "steer_by_wire.tools.analyze.pictures.draw_pictures"
OUR_IDS = {CAN_IDS[kind] for kind in MESSAGE_TYPES.values()}
CYCLIC_IDS = {CAN_IDS[kind] for kind, period_ms in CYCLE_TIMES_MS.items() if period_ms}
FORMATS = (".log", ".log", ".log.gz", ".asc", ".blf", ".csv", ".trc", ".db")
JUDGED_SHARE_MIN = 0.6
"""A loop that does not hold its path looks so from this share of its log on."""


class Damaged(NamedTuple):
    """A log, and what must be said of it; None where anything may.

    ``may_hold``  whether "holds" is true of it if it is so of the loop
    ``is_whole``  whether it shows that a loop does not hold
    """

    entries: list[LogEntry]
    missing: int | None = 0
    repeated: int | None = 0
    foreign: int = 0
    may_hold: bool = True
    is_whole: bool = True


Log = list[LogEntry]


def thinned(rng: Random, log: Log, _other: Log) -> Damaged:
    """Take single frames away, none of the first or last of their kind."""
    ends = {e.frame.can_id: i for i, e in enumerate(log)}
    starts = {e.frame.can_id: i for i, e in reversed(list(enumerate(log)))}
    inside = [
        i
        for i, (_, _, frame) in enumerate(log)
        if frame.can_id in CYCLIC_IDS and starts[frame.can_id] < i < ends[frame.can_id]
    ]
    taken = set(rng.sample(inside, rng.randint(1, len(inside) // 20)))
    return Damaged([e for i, e in enumerate(log) if i not in taken], missing=len(taken))


def doubled(rng: Random, log: Log, _other: Log) -> Damaged:
    """Send cyclic frames again at once."""
    again = {i for i, e in enumerate(log) if e.frame.can_id in CYCLIC_IDS and rng.random() < 0.05}
    out = [e for i, e in enumerate(log) for e in [e] * (2 if i in again else 1)]
    return Damaged(out, repeated=len(again))


def cut(rng: Random, log: Log, _other: Log) -> Damaged:
    """Keep a part, which may be nothing."""
    first, last = sorted(rng.randrange(len(log) + 1) for _ in range(2))
    return Damaged(log[first:last], is_whole=last - first >= JUDGED_SHARE_MIN * len(log))


def shuffled(rng: Random, log: Log, _other: Log) -> Damaged:
    return Damaged(rng.sample(log, len(log)), None, None, may_hold=False)


def swapped(rng: Random, log: Log, _other: Log) -> Damaged:
    """Exchange neighbours with different identifiers, as a recorder of several channels does."""
    out = list(log)
    for i in rng.sample(range(0, len(log) - 1, 2), len(log) // 300):
        if out[i].frame.can_id != out[i + 1].frame.can_id:
            out[i], out[i + 1] = out[i + 1], out[i]
    return Damaged(out)


def among_foreign(rng: Random, log: Log, _other: Log) -> Damaged:
    """Add foreign frames, or leave nothing else."""
    ids = [each for each in range(0x7FF) if each not in OUR_IDS]
    foreign = [
        LogEntry(e.time_ns, e.channel, Frame(rng.choice(ids), rng.randbytes(rng.randint(0, 8))))
        for e in log
        if rng.random() < 0.3
    ]
    is_alone = rng.random() < 0.5
    out = foreign if is_alone else sorted([*log, *foreign], key=lambda e: e.time_ns)
    return Damaged(out, foreign=len(foreign), may_hold=not is_alone)


def reset(rng: Random, log: Log, _other: Log) -> Damaged:
    """Set the clock during the log, forwards or back."""
    at, step_s = rng.randrange(len(log)), rng.choice([-3600.0, -1.0, 0.3, 60.0, 5e3, 1e5, 1.7e9])
    step_ns = round(1e9 * step_s)
    later = [e._replace(time_ns=max(0, (e.time_ns or 0) + step_ns)) for e in log[at:]]
    return Damaged([*log[:at], *later])


def with_another_pair(_rng: Random, log: Log, other: Log) -> Damaged:
    """Put the frames of another pair on the bus."""
    return Damaged(sorted([*log, *other], key=lambda e: e.time_ns), None, None, may_hold=False)


KINDS: Mapping[str, Callable[[Random, Log, Log], Damaged]] = {
    each.__name__: each
    for each in (thinned, doubled, cut, shuffled, swapped, among_foreign, reset, with_another_pair)
}


def written(rng: Random, damaged: Damaged, folder: Path) -> tuple[Path, bool]:
    """Write the log in a drawn format; returns whether a damaged end may cost frames too."""
    suffix = rng.choice(FORMATS)
    path = folder / f"log{suffix}"
    if ".log" not in suffix:
        return convert(damaged.entries, path), False
    newline = rng.choice(["\n", "\n", "\r\n"])
    text = "".join(format_entry(each) + newline for each in damaged.entries)
    is_spoiled = rng.random() < 0.2
    if is_spoiled:  # the program that wrote it was killed, or the disk was full
        text = text[: rng.randrange(len(text) + 1)] + rng.choice(["", "\0" * 50, "(12.5) vc", "é"])
    content = text.encode()
    path.write_bytes(gzip.compress(content) if suffix.endswith("gz") else content)
    return path, is_spoiled


def broken_promises(damaged: Damaged, holds: bool, path: Path, is_spoiled: bool) -> Iterator[str]:
    """Analyse the log; yield what is wrong in what is said of it."""
    out, err = io.StringIO(), io.StringIO()
    figures = path.with_name("figures.json")
    arguments = [str(path), "--out", str(path.with_name("out")), "--json", str(figures)]
    try:
        with redirect_stdout(out), redirect_stderr(err):
            status = analyze(arguments)
    except Exception as error:
        yield f"raised {type(error).__name__}: {error}"
        return
    if status != ExitStatus.OK:
        if (damaged.entries and not is_spoiled) or not is_one_line(err.getvalue(), path):
            yield f"status {status}: {err.getvalue()}"
        return
    found: dict[str, Any] = json.loads(figures.read_text())
    says_holds = out.getvalue().splitlines()[-1].startswith("verdict: holds")
    is_whole = damaged.is_whole and not is_spoiled
    if says_holds and not (damaged.may_hold and (holds or not is_whole)):
        yield out.getvalue().splitlines()[-1]
    if is_spoiled:
        return
    missing = sum(each["missing"] for each in found["messages"].values())
    for name, told, true in (
        ("missing", missing, damaged.missing),
        ("refused", sum(found["refused"].values()), damaged.repeated),
        ("foreign", found["foreign_frames"], damaged.foreign),
        ("frames", found["frames"], len(damaged.entries)),
    ):
        if true is not None and told != true:
            yield f"{told} {name}, truly {true}"


def is_one_line(text: str, path: Path) -> bool:
    return text.count("\n") == 1 and path.name in text


def base_logs(folder: Path) -> dict[bool, Log]:
    """Return the log of a loop that holds its path, and of one that does not."""
    logs = {}
    for holds, loop in LOOPS.items():
        path = folder / f"{holds}.log"
        plant = plant_preset("paper_nominal", [f"duration_s={DURATION_S}", *loop])
        run_virtual_pair(plant, controller_preset("practical_pd"), candump_log=path)
        logs[holds] = entries_in(path)
    return logs


def main() -> int:
    """Draw and analyse; returns 1 if a promise is broken."""
    parser = argparse.ArgumentParser(prog="python -m tests.searches.drawn_logs")
    parser.add_argument("--logs", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    counts, broken = Counter[str](), 0
    with tempfile.TemporaryDirectory() as folder, patch(DRAWS, return_value=[]):
        logs = base_logs(Path(folder))
        for number in range(options.logs):
            rng = Random(f"{options.seed} {number}")
            kind, holds = rng.choice(list(KINDS)), rng.random() < 0.5
            damaged = KINDS[kind](rng, logs[holds], logs[not holds])
            with tempfile.TemporaryDirectory() as own:
                path, is_spoiled = written(rng, damaged, Path(own))
                for mistake in broken_promises(damaged, holds, path, is_spoiled):
                    broken += 1
                    sys.stdout.write(f"{number} {kind} {path.name}, {holds=}: {mistake}\n")
            counts[kind] += 1
    sys.stdout.write(f"{broken} promises broken; {dict(counts)}\n")
    return int(broken > 0)


if __name__ == "__main__":
    sys.exit(main())
