"""Both programs with a key file: they run, refuse and restart, and the key is seen nowhere."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import can
import pytest

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.controller.command_line.program import main as controller_main
from steer_by_wire.dbc.edge import AUTHENTICATED, UNAUTHENTICATED
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    ControllerStatus,
    LateralError,
    SteeringCommand,
    encode,
)
from steer_by_wire.plant_emulator.command_line.program import main as plant_main
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import BITRATE_SWITCH, FD, Frame
from steer_by_wire.runtime.frame.message import frame_of, message_of
from tests.support.frames.made_messages import command_of
from tests.support.programs.running_program import PATIENCE_S, RunningProgram, running

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="key files are refused there; ends programs with SIGINT"
)
KEY = "c0ffee00112233445566778899aabbcc"
OTHER_KEY = "c0ffee00112233445566778899aabbcd"
COMMANDS_MIN = 30


def key_file(path: Path, key: str = KEY) -> str:
    path.write_text(key + "\n", encoding="ascii")
    path.chmod(0o600)
    return str(path)


@pytest.fixture
def key(tmp_path: Path) -> str:
    return key_file(tmp_path / "steer.key")


@pytest.fixture
def bus() -> Iterator[list[str]]:
    """Options by which a program joins an emulated bus with CAN FD."""
    with launched_broker(["--data-bitrate", "2000000"]) as address:
        yield ["-i", "emulated", "--bus-kwargs", f"address={address}"]


def commands(client: can.BusABC, count: int) -> list[Frame]:
    """All frames until ``count`` commands have come."""
    frames: list[Frame] = []
    while sum(frame.can_id == CAN_IDS[SteeringCommand] for frame in frames) < count:
        message = client.recv(PATIENCE_S)
        assert message is not None, "the bus has fallen silent"
        frames.append(frame_of(message))
    return frames


def await_exchange(address: str) -> None:
    """Wait until plant and controller have each sent after the other's frames have reached them."""
    status, measurement = CAN_IDS[ControllerStatus], CAN_IDS[LateralError]
    with can.Bus(interface="emulated", address=address, fd=True, ignore_config=True) as client:
        for can_id in (measurement, status, measurement, measurement, status, status):
            while (message := client.recv(PATIENCE_S)) and message.arbitration_id != can_id:
                pass
            assert message is not None, "the bus has fallen silent"


def text_of(paths: Sequence[Path], programs: Sequence[RunningProgram]) -> str:
    """All that was written and printed, in lower case."""
    printed = [line for program in programs for line in program.printed]
    read = [path.read_bytes().decode("latin-1") for path in paths]
    return "\n".join([*printed, *read]).lower()


def test_a_pair_with_a_key_withstands_an_intruder_and_a_restart_and_shows_no_key(
    tmp_path: Path, key: str, bus: list[str]
) -> None:
    _, address = bus[-1].split("=")
    plant_options = [*bus, "--key-file", key, "--record", str(tmp_path / "run.log")]
    controller_options = [*bus, "--key-file", key]
    reports = [tmp_path / f"{name}.json" for name in ("plant", "first", "second")]
    with (
        can.Bus(interface="emulated", address=address, fd=True, ignore_config=True) as client,
        running("steer_by_wire.plant_emulator", plant_options, reports[0]) as plant,
    ):
        with running("steer_by_wire.controller", controller_options, reports[1]) as first:
            heard = commands(client, COMMANDS_MIN)
            assert first.interrupt() == ExitStatus.OK
        with running("steer_by_wire.controller", controller_options, reports[2]) as second:
            commands(client, COMMANDS_MIN)
            for frame in heard:
                client.send(message_of(frame))
            spoof = encode(command_of(0.6, 1), 1)
            guess = Frame(spoof.can_id, spoof.data + b"\x55" * 12, FD | BITRATE_SWITCH)
            for frame in (spoof, guess) * 10:
                client.send(message_of(frame))
            commands(client, COMMANDS_MIN)
            assert second.interrupt() == ExitStatus.OK
        assert plant.interrupt() == ExitStatus.OK
    figures = plant.report()["node"]["authentication"]
    # Before it has answered the plant's challenge, the controller sends zeros for a code.
    old = [any(frame.data[12:]) for frame in heard if frame.can_id in (0x100, 0x304, 0x308)]
    own = sum(frame.can_id in (0x110, 0x120, 0x130, 0x310) for frame in heard)
    refused = figures["refused"]
    assert refused["unauthenticated"] == 10 + own
    assert refused["forged"] == 10 + sum(old)  # bound to the challenge of the first controller
    assert refused.get("unsynchronised", 0) >= old.count(False)
    assert refused["replayed"] == sum(frame.can_id == 0x300 for frame in heard)
    assert figures["verified"] >= 3 * COMMANDS_MIN
    assert any(AUTHENTICATED in line for line in plant.printed)
    forged = f"refused by authentication: forged {refused['forged']}"
    assert any(forged in line for line in plant.printed)
    assert set(second.report()["node"]["authentication"]["refused"]) <= {
        *("unsynchronised", "forged", "replayed", "unauthenticated")
    }
    everything = text_of([*reports, tmp_path / "run.log"], [plant, first, second])
    assert key.lower() not in text_of(reports, [])  # not even where it is
    for shown in (KEY, repr(bytes.fromhex(KEY))[2:-1].lower(), KEY[:16], KEY[16:]):
        assert shown not in everything


def test_both_ends_say_what_they_refuse_where_a_key_is_different_or_missing(
    tmp_path: Path, key: str, bus: list[str]
) -> None:
    other = key_file(tmp_path / "other.key", OTHER_KEY)
    _, address = bus[-1].split("=")
    reports = [tmp_path / f"{name}.json" for name in ("plant", "other", "keyless")]
    with running("steer_by_wire.plant_emulator", [*bus, "--key-file", key], reports[0]) as plant:
        with running(
            "steer_by_wire.controller", [*bus, "--key-file", other], reports[1]
        ) as different:
            await_exchange(address)
            assert different.interrupt() == ExitStatus.OK
        with running("steer_by_wire.controller", [*bus, "--fd"], reports[2]) as keyless:
            await_exchange(address)
            assert keyless.interrupt() == ExitStatus.OK
        assert plant.interrupt() == ExitStatus.OK
    figures = plant.report()["node"]["authentication"]
    assert figures["verified"] == 0
    # Until the other controller has seen the plant's challenge, it can only send without a code.
    assert figures["refused"].keys() == {"forged", "unauthenticated", "unsynchronised"}
    assert different.report()["node"]["authentication"]["verified"] == 0
    assert different.report()["node"]["commands_sent"] == 0
    assert sum("of the controller fail authentication: another" in x for x in plant.printed) == 2
    assert sum(UNAUTHENTICATED in line for line in keyless.printed) == 1
    rejected = keyless.report()["node"]["rejected"]
    assert set(rejected) == {"no_key"}
    assert any(f"frames refused: {rejected['no_key']}" in line for line in keyless.printed)


@pytest.mark.parametrize("main", [plant_main, controller_main])
def test_a_key_file_that_cannot_be_used_is_one_line_and_status_2(
    capsys: pytest.CaptureFixture[str], main: object, key: str
) -> None:
    assert callable(main)
    Path(key).chmod(0o640)
    assert main(["--key-file", key, "-i", "virtual"]) == ExitStatus.SETTINGS
    (line,) = (line for line in capsys.readouterr().err.splitlines() if "error:" in line)
    assert f"error: {key}: " in line
    assert line.endswith("chmod 600 it")


def test_a_bus_for_classic_frames_only_is_one_line_and_status_3(tmp_path: Path, key: str) -> None:
    with launched_broker() as address:
        options = ["-i", "emulated", "--bus-kwargs", f"address={address}", "--key-file", key]
        with running("steer_by_wire.plant_emulator", options, tmp_path / "p.json") as plant:
            assert plant.end() == ExitStatus.BUS
    (line,) = plant.printed
    assert "start it with --data-bitrate for CAN FD" in line
