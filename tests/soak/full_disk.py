"""Let a disk fail at every use that a program makes of it, or kill it there, and judge the end.

    python -m tests.soak.full_disk [--seed 1] [--share 1.0]

Each program first leaves its results, then runs again into the same place while use n of the disk
fails, for every n: only that one, or all from there on. And it is killed (-9) there while it runs
for the first time. The promise:

    the program    one line that names the file and the cause, and status 4
    whole files    those of before or those of now, never a part, and no temporary one is left
    a recording    the failure, and no more frames than can be read from the file
    after a kill   the same command runs again, to its end

Prints what breaks it, and the count of tries. ``--share`` draws some of them, by the seed.
"""

import argparse
import importlib
import io
import json
import os
import shutil
import signal
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from random import Random
from typing import NamedTuple

from steer_by_wire.closed_loop.recordings.log_file import LogError, open_log
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.recording.recorder_process import record
from steer_by_wire.runtime.recording.recording import RECORD
from tests.support.programs.failing_disk import FailingDisk, failing_disk

STUDY = """
name = "small"
[base]
plant_preset = "paper_corner_d"
controllers = ["practical_pd"]
[base.plant]
duration_s = 2.0
[[factors]]
key = "plant.latency.downlink.mean_s"
values = [0.0, 0.08]
"""
CAUSE = "No space left on device"
PROGRAMS: Mapping[str, tuple[str, Sequence[str]]] = {
    "run": ("run", ("--duration", "0.5", "--out", "run")),
    "can bits": ("can", ("bits", "123#11", "--json", "bits.json")),
    "replay": ("cockpit", ("../log/candump.log", "--export", "page.html")),
    "generate-c": ("generate_c", ("--out", "c")),
    "study": ("study", ("../study.toml", "--out", "study", "--no-report", "--workers", "1")),
    "analyze": ("analyze", ("../log/candump.log", "--out", "an", "--mcap")),
}
RECORDINGS = (".log", ".asc", ".csv", ".trc", ".blf")
FRAMES = 200
_TEMPORARY = (".partial", ".writing", ".part", ".new")


class Try(NamedTuple):
    """What is tried, and which use of the disk fails: all later ones too if ``stays_full``."""

    name: str
    fails_at: int | None
    stays_full: bool = True
    kills: bool = False


def prepare(place: Path) -> None:
    """Leave in ``place`` what the programs read."""
    main = importlib.import_module("steer_by_wire.tools.run.__main__").main
    with redirect_stdout(io.StringIO()):
        assert main(["--duration", "2", "--out", str(place / "log")]) == 0
    (place / "study.toml").write_text(STUDY, encoding="utf-8")


def attempt(place: Path, one: Try) -> FailingDisk:
    """Try ``one`` in a folder of ``place``; raises AssertionError when it breaks the promise."""
    folder = place / one.name.replace(" ", "_").replace(".", "_")
    folder.mkdir(exist_ok=True)
    if one.name in RECORDINGS:
        return _attempt_recording(folder, one)
    before = files_in(folder)
    if one.kills:
        _kill(folder, one)
        for name, content in files_in(folder).items():
            assert name.endswith(_TEMPORARY) or is_whole(name, content), (one, name)
        one = one._replace(fails_at=None)
    status, said, disk = _run(folder, one)
    if not disk.has_failed:
        assert status == ExitStatus.OK, (one, said)
        left = [name for name in files_in(folder) if name.endswith(_TEMPORARY)]
        assert not left, (one, left)
        return disk
    assert status == ExitStatus.OUTPUT, (one, status, said)
    assert "\n" not in said, (one, said)
    assert ": error: " in said, (one, said)
    assert said.endswith(f": {CAUSE}"), (one, said)
    named = said.split(": error: ")[1].removesuffix(f": {CAUSE}")
    assert (folder / named).parent.parent.exists(), (one, said)
    for name, content in files_in(folder).items():
        assert not name.endswith(_TEMPORARY), (one, name)
        assert content == before.get(name) or is_whole(name, content), (one, name)
    return disk


def _run(folder: Path, one: Try) -> tuple[int, str, FailingDisk]:
    """Run a program; returns its status, what it has said, and the disk."""
    module, words = PROGRAMS[one.name]
    main = importlib.import_module(f"steer_by_wire.tools.{module}.__main__").main
    out, err = io.StringIO(), io.StringIO()
    with (
        chdir(folder),
        redirect_stdout(out),
        redirect_stderr(err),
        failing_disk(folder, one.fails_at, stays_full=one.stays_full, kills=one.kills) as disk,
    ):
        status = main(list(words))
    return status, err.getvalue().strip(), disk


def _kill(folder: Path, one: Try) -> None:
    """Run a program into an empty folder, in a process that is killed at a use of the disk.

    One that has fewer uses there than where its results already were ends well by itself.
    """
    shutil.rmtree(folder)
    folder.mkdir()
    pid = os.fork()
    if not pid:
        ended = -1
        try:
            ended, _, _ = _run(folder, one)
        finally:
            os._exit(ended & 0xFF)
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) in (-signal.SIGKILL, ExitStatus.OK), (one, status)


def files_in(folder: Path) -> dict[str, bytes]:
    """Return the content of all files below ``folder``, by name."""
    files = (file for file in folder.rglob("*") if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def is_whole(name: str, content: bytes) -> bool:
    """Whether a file that is written in one go is there to its end; a stream may be cut."""
    try:
        match Path(name).suffix:
            case ".json":
                json.loads(content)
            case ".toml":
                return bool(tomllib.loads(content.decode()))
            case ".html":
                return content.rstrip().endswith(b"</html>")
    except ValueError:
        return False
    return True


def _attempt_recording(folder: Path, one: Try) -> FailingDisk:
    """Record frames, in this process."""
    path = folder / f"run{one.name}"
    path.unlink(missing_ok=True)
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    frames = (Frame(0x100 + n, bytes([n % 256] * 8)) for n in range(FRAMES))
    for number, (can_id, data, flags) in enumerate(frames):
        os.write(writer, RECORD.pack(10**18 + number * 10**7, can_id, flags, 1, 8) + data)
    os.close(writer)
    saved = os.dup(1)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)  # where the recorder says that it is ready
    try:
        with (
            open(reader, "rb", closefd=True) as source,
            failing_disk(folder, one.fails_at, stays_full=one.stays_full) as disk,
        ):
            summary = record(path, "can0", source, -1)
    finally:
        os.dup2(saved, 1)
        os.close(saved)
        os.close(null)
    assert bool(summary["failure"]) is disk.has_failed, (one, summary)
    assert summary["failure"] in ("", CAUSE), (one, summary)
    assert summary["frames"] <= readable(path), (one, summary)
    assert disk.has_failed or summary["frames"] == FRAMES, (one, summary)
    return disk


def readable(path: Path) -> int:
    """Return how many frames can be read from a log."""
    try:
        return sum(1 for _ in open_log(path))
    except LogError:
        return 0


def tries(place: Path, names: Sequence[str], random: Random, share: float) -> Iterator[Try]:
    """Yield a share of all tries of the named ones, drawn."""
    for name in names:
        uses = attempt(place, Try(name, None)).uses
        for fails_at in range(1, uses + 1):
            ways = [Try(name, fails_at), Try(name, fails_at, stays_full=False)]
            ways += [Try(name, fails_at, kills=True)] * (name in PROGRAMS)
            yield from (one for one in ways if random.random() < share)


def search(names: Sequence[str], seed: int, share: float, note: Callable[[str], None]) -> int:
    """Try a share of all there is, and note what breaks the promise; returns the count."""
    count = 0
    with tempfile.TemporaryDirectory() as made:
        place = Path(made)
        prepare(place)
        for one in tries(place, names, Random(seed), share):
            count += 1
            try:
                attempt(place, one)
            except AssertionError as broken:
                note(str(broken))
    return count


def main() -> int:
    """Run the whole search."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.full_disk", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--share", type=float, default=1.0)
    options = parser.parse_args()
    broken: list[str] = []
    for name in (*PROGRAMS, *RECORDINGS):
        before = len(broken)
        count = search([name], options.seed, options.share, broken.append)
        print(*broken[before:], sep="\n", end="")  # noqa: T201 it reports to whoever starts it
        print(f"{name}: {count} tries, {len(broken) - before} promises broken", flush=True)  # noqa: T201
    return bool(broken)


if __name__ == "__main__":
    sys.exit(main())
