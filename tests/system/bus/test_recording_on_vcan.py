"""A pair with a key on a real vcan0: candump reads it, and both recordings agree with candump."""

import subprocess
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from steer_by_wire.closed_loop.recordings.log_analysis import analyse_files
from steer_by_wire.closed_loop.recordings.log_file import open_log
from steer_by_wire.runtime.exit_status import ExitStatus
from tests.support.programs.running_program import running, wait_until

pytestmark = pytest.mark.vcan

BUS = ["-i", "socketcan", "-c", "vcan0"]
DOWNLINK_S, UPLINK_S = 0.08, 0.02
PLANT = [
    "--set", f"latency.downlink.mean_s={DOWNLINK_S}", "--set", f"latency.uplink.mean_s={UPLINK_S}",
]  # fmt: skip
COMMANDS = 60


class Run(NamedTuple):
    """What is left of a run: logs, and reports by program."""

    candump: Path
    plant: Path
    controller: Path
    reports: dict[str, Any]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("run")
    key = folder / "steer.key"
    key.write_text("c0ffee00112233445566778899aabbcc\n", encoding="ascii")
    key.chmod(0o600)
    logs = Run(folder / "candump.log", folder / "plant.blf", folder / "controller.log", {})
    with ExitStack() as stack:
        output = stack.enter_context(logs.candump.open("wb"))
        candump = subprocess.Popen(
            ["candump", "-L", "vcan0"], stdin=subprocess.DEVNULL, stdout=output
        )
        stack.callback(candump.wait)
        stack.callback(candump.terminate)
        programs = {}
        for name, log, options in (
            ("plant_emulator", logs.plant, PLANT),
            ("controller", logs.controller, []),
        ):
            report = folder / f"{name}.json"
            options = [*BUS, "--key-file", str(key), "--record", str(log), *options]
            program = running(f"steer_by_wire.{name}", options, report)
            programs[name] = stack.enter_context(program)
        wait_until(
            lambda: logs.controller.read_text().count(" 100##") >= COMMANDS, "enough commands"
        )
        for name in ("controller", "plant_emulator"):
            assert programs[name].interrupt() == ExitStatus.OK
            logs.reports[name] = programs[name].report()
        last = logs.reports["plant_emulator"]["loop"]["frames_sent"]
        wait_until(lambda: logs.candump.read_bytes().count(b"\n") >= last, "candump's last line")
        time.sleep(0.1)
    return logs


def frames_of(path: Path) -> Counter[tuple[int, bytes]]:
    return Counter((logged.frame.can_id, logged.frame.data) for logged in open_log(path))


def test_authenticated_frames_are_believed_and_seen_by_candump(run: Run) -> None:
    plant = run.reports["plant_emulator"]
    assert plant["node"]["authentication"]["refused"].keys() <= {"unsynchronised"}
    assert plant["connection"]["driver"] == "AF_CAN"
    assert {len(data) for _, data in frames_of(run.candump)} == {20, 48}


def test_the_plants_recording_holds_what_candump_has_seen(run: Run) -> None:
    seen, recorded = frames_of(run.candump), frames_of(run.plant)
    assert run.reports["plant_emulator"]["recording"]["dropped"] == 0
    not_for_it = {0x304, 0x308}
    assert {can_id for can_id, _ in recorded} == {can_id for can_id, _ in seen} - not_for_it
    assert (recorded - seen).total() == 0
    dropped = run.reports["plant_emulator"]["connection"]["frames_dropped"]
    missed = Counter({key: n for key, n in (seen - recorded).items() if key[0] not in not_for_it})
    assert missed.total() <= dropped


def test_recordings_and_candump_tell_the_same_round_trip(run: Run) -> None:
    trips = [
        analyse_files([path]).figures["latency"]["round_trip"]
        for path in (run.candump, run.plant, run.controller)
    ]
    for trip in trips:
        assert trip["samples"] > COMMANDS / 4
        # The recorders' clocks may be slewed meanwhile, by half a thousandth.
        assert trip["min_s"] >= 0.999 * (DOWNLINK_S + UPLINK_S)


def test_recordings_and_candump_know_both_directions(run: Run) -> None:
    for path in (run.candump, run.plant, run.controller):
        latency = analyse_files([path]).figures["latency"]
        assert latency["is_absolute"]
        # Drawn, not measured. It is 0 before the first frame, however late that comes.
        assert latency["reported_uplink"]["max_s"] == pytest.approx(UPLINK_S, abs=5e-4)
        assert latency["reported_downlink"]["max_s"] == pytest.approx(DOWNLINK_S, abs=5e-4)
