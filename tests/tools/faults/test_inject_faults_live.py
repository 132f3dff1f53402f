"""The live injector at work on a live pair: what happens, and no time."""

import subprocess
import sys
from pathlib import Path

import can

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.dbc.messages import CAN_IDS, Decoded, Mode, SteeringCommand, decode
from steer_by_wire.runtime.frame.message import frame_of
from tests.support.programs.running_program import running, wait_until

COMMAND_ID = CAN_IDS[SteeringCommand]


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


def test_a_live_pair_refuses_spoofed_commands(tmp_path: Path) -> None:
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
            report = tmp_path / "injector.json"
            injector = [
                sys.executable,
                "-m",
                "steer_by_wire.tools.faults.__main__",
                "spoof,duration_s=0.5",
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
