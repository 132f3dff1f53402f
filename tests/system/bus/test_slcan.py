"""Both programs through python-can's ``slcan`` and emulated adapters, which can be unplugged."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from steer_by_wire.dbc.messages import CAN_IDS, Mode, SteeringCommand
from steer_by_wire.runtime.exit_status import ExitStatus
from tests.support.frames.decoded_frames import messages_in
from tests.support.programs.running_program import RunningProgram, running, wait_until
from tests.support.programs.slcan_adapter import Adapter, AdapterBus

pytest.importorskip("serial", reason="python-can's slcan needs pyserial")
if sys.platform == "win32":
    pytest.skip("Windows has no pseudo-terminals", allow_module_level=True)

PLANT, CONTROLLER = 0, 1


@pytest.fixture
def bus(tmp_path: Path) -> Iterator[AdapterBus]:
    with AdapterBus([tmp_path / "tty_plant", tmp_path / "tty_controller"]) as adapters:
        yield adapters


def options(adapter: Adapter, *more: str) -> list[str]:
    arguments = ("--bus-kwargs", "sleep_after_open=0")
    return ["-i", "slcan", "-c", str(adapter.path), "-b", "500000", *arguments, *more]


def start_plant(stack: ExitStack, bus: AdapterBus, *more: str) -> RunningProgram:
    report = bus.adapters[PLANT].path.with_name("plant.json")
    given = options(bus.adapters[PLANT], *more)
    return stack.enter_context(running("steer_by_wire.plant_emulator", given, report))


def start_controller(stack: ExitStack, bus: AdapterBus, *more: str) -> RunningProgram:
    report = bus.adapters[CONTROLLER].path.with_name("controller.json")
    given = options(bus.adapters[CONTROLLER], "--preset", "practical_pd_ddob", *more)
    return stack.enter_context(running("steer_by_wire.controller", given, report))


def commands(bus: AdapterBus) -> list[SteeringCommand]:
    """The steering commands that the controller's adapter was given so far."""
    frames = [
        frame
        for frame in list(bus.adapters[CONTROLLER].frames)
        if frame.can_id == CAN_IDS[SteeringCommand]
    ]
    found = messages_in(frames, SteeringCommand)
    assert len(found) == len(frames)
    return found


def wait_for_mode(bus: AdapterBus, mode: Mode) -> None:
    wait_until(lambda: mode in {command.mode for command in commands(bus)}, f"mode {mode.name}")


def test_the_pair_closes_the_loop(bus: AdapterBus) -> None:
    with ExitStack() as stack:
        controller = start_controller(stack, bus)
        plant = start_plant(stack, bus, "--set", "duration_s=1")
        assert plant.end() == ExitStatus.OK
        assert controller.interrupt() == ExitStatus.OK
        assert plant.report()["ended_by"] == "finished"
        for program in (plant, controller):
            report = program.report()
            assert report["node"]["accepted"] > 0
            assert report["node"]["rejected"] == {}
            assert report["connection"]["driver"] == "python-can"
    assert Mode.ACTIVE in {command.mode for command in commands(bus)}


def test_bit_rate_and_listening_only_reach_the_adapter(bus: AdapterBus) -> None:
    with ExitStack() as stack:
        plant = start_plant(stack, bus)
        arguments = ("--bus-kwargs", "sleep_after_open=0", "listen_only=True")
        controller = start_controller(stack, bus, *arguments)
        # One that steers by then ends without an effect.
        assert controller.interrupt() in (ExitStatus.OK, ExitStatus.CONDITION)
        assert plant.interrupt() == ExitStatus.OK
        assert plant.report()["node"]["accepted"] == 0
    ends = [adapter.commands for adapter in bus.adapters]
    wait_until(lambda: all(end[-1] == "C" for end in ends), "the end of both")
    assert [end[-4:] for end in ends] == [["S6", "O", "O", "C"], ["S6", "L", "L", "C"]]


def test_an_unplugged_adapter_ends_the_run_with_one_line_a_report_and_status_3(
    bus: AdapterBus,
) -> None:
    with ExitStack() as stack:
        plant = start_plant(stack, bus)
        controller = start_controller(stack, bus)
        wait_for_mode(bus, Mode.ACTIVE)
        bus.unplug(CONTROLLER)
        assert controller.end() == ExitStatus.BUS
        (error,) = [line for line in controller.printed if "error:" in line]
        assert "cannot receive" in error or "cannot send" in error
        report = controller.report()
        assert report["ended_by"] in error
        assert report["node"]["commands_sent"] > 0
        assert plant.interrupt() == ExitStatus.OK
