"""Full disks and killed programs: one clear line, no file that is half written.

A program that cannot write says which file and why, and ends with status 4. Files that are written
in one go are whole or as they were. A node whose broker is killed ends with status 3; what its
report counts is in its recording.
"""

import importlib
import json
import tomllib
from collections.abc import Sequence
from contextlib import ExitStack, chdir
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.closed_loop.pair.live_bus import Bus
from steer_by_wire.closed_loop.pair.live_pair import PROGRAMS, LivePair
from steer_by_wire.closed_loop.pair.pair_result import PairFiles
from steer_by_wire.closed_loop.recordings.log_file import open_log
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.exit_status import ExitStatus
from tests.support.programs.broker_program import directory as directory
from tests.support.programs.broker_program import stack as stack
from tests.support.programs.broker_program import start_broker
from tests.support.programs.driven_pair import BEAR_ALL, CONTROLLER
from tests.support.programs.failing_disk import failing_disk
from tests.support.programs.running_program import wait_until

COMMANDS = {
    "run": ("--duration", "0.5", "--out", "out"),
    "generate_c": ("--out", "out"),
    "analyze": ("../log/candump.log", "--out", "out"),
}
CAUSE = "No space left on device"
CHECKS: dict[str, Any] = {".json": json.loads, ".toml": tomllib.loads}


def run(command: str, arguments: Sequence[str]) -> int:
    status: int = importlib.import_module(f"steer_by_wire.tools.{command}.__main__").main(arguments)
    return status


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("disk")
    assert run("run", ["--duration", "0.5", "--out", str(place / "log")]) == ExitStatus.OK
    return place


def contents(folder: Path) -> dict[Path, bytes]:
    return {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_full_disk_is_one_line_and_leaves_whole_files(
    command: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = place / command
    folder.mkdir()
    with chdir(folder), failing_disk(folder, None) as disk:
        assert run(command, COMMANDS[command]) == ExitStatus.OK
    before = contents(folder)
    capsys.readouterr()
    for fails_at in sorted({1, disk.uses // 2, disk.uses}):
        with chdir(folder), failing_disk(folder, fails_at) as full:
            status = run(command, COMMANDS[command])
        said = capsys.readouterr().err.strip()
        if not full.has_failed:
            assert status == ExitStatus.OK
            continue
        assert (status, said.count("\n")) == (ExitStatus.OUTPUT, 0), said
        assert ": error: " in said
        assert said.endswith(f": {CAUSE}")
        for file, content in contents(folder).items():
            assert file in before or not file.name.endswith((".partial", ".writing", ".part"))
            if file.suffix in CHECKS and content != before.get(file):
                CHECKS[file.suffix](content.decode())


def test_nodes_end_with_a_killed_broker_and_keep_their_recordings(
    stack: ExitStack, directory: Path, tmp_path: Path
) -> None:
    address = str(directory / "socket")
    broker = start_broker(stack, "--address", address)
    files = PairFiles(tmp_path)
    files.write_settings(PlantSettings(duration_s=600.0, overruns=BEAR_ALL), CONTROLLER)
    logs = {name: tmp_path / f"{name}.log" for name in PROGRAMS}
    options = {name: ["--record", str(log)] for name, log in logs.items()}
    bus = Bus("emulated", "can0", {"address": address})
    with LivePair(bus, files, options=options, is_recorded=False) as pair:
        pair.wait_until_ready()
        wait_until(lambda: all(log.stat().st_size for log in logs.values()), "recorded frames")
        broker.kill()
        wait_until(
            lambda: all(pair.programs.status(name) is not None for name in PROGRAMS), "the ends"
        )
        for name in PROGRAMS:
            said = pair.programs.path(name, ".txt").read_text("utf-8")
            assert (pair.programs.status(name), said.count(": error: ")) == (ExitStatus.BUS, 1)
            assert "Traceback" not in said
            counted = json.loads(files.report(name).read_text("utf-8"))["recording"]["frames"]
            assert sum(1 for _ in open_log(logs[name])) >= counted
