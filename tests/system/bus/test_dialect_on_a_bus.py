"""Both programs in real time, each behind its gateway: structure only, as a machine may stall."""

from pathlib import Path

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from tests.support.programs.running_program import running

CAR = Path(__file__).parents[2] / "dbc" / "dialect" / "my_car.toml"
DIALECT = ("--dialect", str(CAR))


def test_two_programs_speak_the_car_s_messages(tmp_path: Path) -> None:
    with launched_broker() as address:
        bus = ("-i", "emulated", "-c", "can0", "--bus-kwargs", f"address={address}")
        report, other = tmp_path / "plant.json", tmp_path / "controller.json"
        fault = 'faults=[{kind="duplicate", direction="uplink", message="MOTION"}]'
        drive = ("--duration", "60", "--set", "safety.ftti_ms=off", "--set", fault)
        with (
            running("steer_by_wire.plant_emulator", [*bus, *DIALECT, *drive], report) as plant,
            running("steer_by_wire.controller", [*bus, *DIALECT], other) as controller,
        ):
            plant.wait_for("FOLLOWING")
            controller.wait_for("ACTIVE|steers")
            controller.interrupt()
            plant.interrupt()
            reports = plant.report()["node"], controller.report()["node"]
    for node in reports:
        assert node["dialect"]["accepted"] > 0
        assert node["dialect"]["sent"] > 0
        damaged = {"bad checksum", "wrong length", "out of range"}
        assert not damaged & set(node["dialect"]["refused"])
    assert reports[0]["faults"][0]["changed"] > 0
    assert any("dialect: " in line for line in plant.printed)
