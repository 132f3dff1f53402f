"""The live injector at work: on processes, on a bus, on clocks, and on a live pair.

The live run asserts what happens, and no time: a shared machine may stall for long.
"""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.dbc.messages import CAN_IDS, Decoded, Mode, SteeringCommand, decode
from steer_by_wire.runtime.frame.message import frame_of
from steer_by_wire.tools.faults import __main__ as inject_faults
from tests.support.programs.running_program import PATIENCE_S, running, wait_until

BITRATE_BIT_S = 500_000
START_NS = 7_000_000_000
COMMAND_ID = CAN_IDS[SteeringCommand]


# Processes


@pytest.fixture
def sleeper() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(3600)"]) as process:
        yield process
        process.kill()


def state_of(pid: int) -> str:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


@pytest.mark.skipif(sys.platform != "linux", reason="processes are held by descriptors of Linux")
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_whatever_ends_the_injector_a_paused_process_goes_on(
    end: signal.Signals, sleeper: subprocess.Popen[bytes]
) -> None:
    words = [f"pause,duration_s=1000,pid={sleeper.pid}"]
    with subprocess.Popen(
        [sys.executable, "-m", "steer_by_wire.tools.faults.__main__", *words],
        stdout=subprocess.PIPE,
        text=True,
    ) as injector:
        wait_until(lambda: state_of(sleeper.pid) == "T", "the process stops")
        injector.send_signal(end)
        printed, _ = injector.communicate(timeout=PATIENCE_S)
    assert injector.returncode == 0
    assert state_of(sleeper.pid) != "T"
    assert f"SIGSTOP to process {sleeper.pid}" in printed
    assert printed.splitlines()[-1].endswith(f"pause: SIGCONT to process {sleeper.pid}")


@pytest.mark.skipif(sys.platform != "linux", reason="processes are held by descriptors of Linux")
def test_a_killed_process_is_killed_once_and_what_comes_later_is_reported(
    sleeper: subprocess.Popen[bytes], capsys: pytest.CaptureFixture[str]
) -> None:
    pid = sleeper.pid
    words = [f"kill,pid={pid}", f"pause,onset_s=0.2,duration_s=0.01,pid={pid}"]
    assert inject_faults.main(words) == 0
    printed = capsys.readouterr().out
    assert f"kill: SIGKILL to process {sleeper.pid}" in printed
    assert sleeper.wait(PATIENCE_S) == -signal.SIGKILL


# A live pair


def wait_for_control(address: str) -> None:
    """Wait until the controller steers: one that waits yet has nothing to hold."""

    def steers(message: can.Message) -> bool:
        if message.arbitration_id != COMMAND_ID:
            return False
        decoded = decode(frame_of(message))
        return (
            isinstance(decoded, Decoded)
            and isinstance(decoded.message, SteeringCommand)
            and decoded.message.mode is Mode.ACTIVE
        )

    with can.Bus(interface="emulated", channel="can0", address=address) as bus:
        # Each time all that has come by then: one at a time would fall behind the bus.
        wait_until(
            lambda: any(map(steers, iter(lambda: bus.recv(0.0), None))), "a command in ACTIVE"
        )


def test_a_live_pair_refuses_spoofed_commands_and_holds_while_the_plant_is_paused(
    tmp_path: Path,
) -> None:
    with launched_broker() as address:
        bus = ["-i", "emulated", "-c", "can0", "--bus-kwargs", f"address={address}"]
        plant_options = ["--set", "duration_s=600", *bus]
        with (
            running(
                "steer_by_wire.plant_emulator", plant_options, tmp_path / "plant.json"
            ) as plant,
            running(
                "steer_by_wire.controller",
                [*bus, "--preset", "practical_pd"],
                tmp_path / "controller.json",
            ) as controller,
        ):
            wait_for_control(address)
            pause = f"pause,onset_s=0.7,duration_s=0.6,pid={plant.pid}"
            words = ["spoof,duration_s=0.5", pause]
            report = tmp_path / "injector.json"
            injector = [
                sys.executable,
                "-m",
                "steer_by_wire.tools.faults.__main__",
                *words,
                *bus,
            ]
            done = subprocess.run(
                [*injector, "--json", str(report)], capture_output=True, text=True, check=True
            )
            assert plant.interrupt() == 0
            assert controller.interrupt() == 0
    assert "spoof: begins" in done.stdout
    assert [line for line in done.stdout.splitlines() if "frames sent" in line]
    # Whether its counter fits or not, some are refused: the spoofed ones, or the true ones.
    assert sum(plant.report()["node"]["rejected"].values()) > 0
    # The controller knows its own identifier; the plant only counters that lie near each other.
    assert controller.report()["node"]["second_senders"] == ["STEERING_COMMAND"]
    assert plant.report()["node"]["second_senders"] in ([], ["STEERING_COMMAND"])
    assert controller.report()["node"]["holds"] >= 1
