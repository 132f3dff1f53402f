"""Compiled functions on disk: one process compiles what several need."""

import json
import os
import random
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from steer_by_wire.closed_loop.compiled.compilation import (
    DigestedFiles,
    _forget_unused,
    _in_one_process,
)
from steer_by_wire.closed_loop.compiled.law_code import is_of_numba

COMPILE_AND_COUNT = """
import os
before = dict(os.environ)
import numba
from steer_by_wire.closed_loop.compiled.network import _run_scores
stats = _run_scores.stats
for kind in (numba.float64, numba.float32):
    print("ready", flush=True)
    input()
    _run_scores.compile((kind[::1], kind[::1]))
    print(sum(stats.cache_misses.values()), sum(stats.cache_hits.values()), flush=True)
assert os.environ == before
"""
"""Compiles twice, and leaves numba as it was for the rest of the process."""


@pytest.mark.skipif(sys.platform == "win32", reason="files are locked on POSIX only")
def test_processes_compile_what_they_need_once_and_go_on_when_their_folder_has_been_removed(
    tmp_path: Path,
) -> None:
    """The oldest folders go when there are newer sources, and a design runs for minutes."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    command = [sys.executable, "-c", COMPILE_AND_COUNT]
    streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    processes = [subprocess.Popen(command, env=environment, text=True, **streams) for _ in range(2)]
    assert answers(processes) == ["ready\n", "ready\n"]
    assert answers(processes, "\n") == ["0 1\n", "1 0\n"]
    assert answers(processes) == ["ready\n", "ready\n"]
    shutil.rmtree(tmp_path / "steer-by-wire-emulator")
    compiled = [process.communicate("\n")[0].split() for process in processes]
    assert [sum(map(int, counts)) for counts in compiled] == [2, 2]
    assert [process.returncode for process in processes] == [0, 0]


def answers(processes: list[subprocess.Popen[str]], said: str = "") -> list[str]:
    """Say this to all, and return the next line of each."""
    for process in processes:
        assert process.stdin is not None
        process.stdin.write(said)
        process.stdin.flush()
    return sorted(process.stdout.readline() for process in processes if process.stdout is not None)


def test_code_that_a_process_may_use_yet_stays_on_disk(tmp_path: Path) -> None:
    """The newest folders stay, and of the others those that somebody began with lately."""
    age_s = {"now": 0, "a": 100, "b": 200, "c": 7200, "d": 3500, "e": 7300, "f": 90000}
    for name, age in age_s.items():
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (1e9 - age, 1e9 - age))
    _forget_unused(tmp_path)
    assert sorted(folder.name for folder in tmp_path.iterdir()) == ["a", "b", "d", "now"]


def test_two_processes_may_forget_the_same_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = tmp_path / "gone"
    monkeypatch.setattr(Path, "iterdir", lambda _folder: iter([gone, tmp_path]))
    _forget_unused(tmp_path)
    assert tmp_path.exists()


def test_damaged_code_is_forgotten_and_never_loaded(tmp_path: Path) -> None:
    rng = random.Random(58)
    files = DigestedFiles(str(tmp_path), "step", "stamp")
    for _ in range(200):
        files.save("key", ["code"])
        assert files.load("key") == ["code"]
        file = rng.choice(sorted(tmp_path.iterdir()))
        content = bytearray(file.read_bytes())
        if rng.random() < 0.5:
            content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        else:
            del content[rng.randrange(len(content)) :]
        file.write_bytes(content)
        assert files.load("key") is None


def test_code_that_no_disk_takes_is_not_kept(tmp_path: Path) -> None:
    no_folder = tmp_path / "file"
    no_folder.touch()
    DigestedFiles(str(no_folder), "step", "stamp").save("key", ["code"])
    waiting = _in_one_process(lambda arguments: arguments, "step", no_folder / "locks")
    assert waiting("compiled") == "compiled"


def test_what_compiled_code_raises_is_no_error_of_numba() -> None:
    def falls(x: float) -> float:
        if x > 0.0:
            raise NotImplementedError
        return x

    def unknown(x: float) -> str:
        return json.dumps(x)

    for function, is_numbas in ((falls, False), (unknown, True)):
        with pytest.raises(Exception) as raised:  # noqa: PT011 of two kinds
            numba.njit(function)(1.0)
        assert is_of_numba(raised.value) == is_numbas
