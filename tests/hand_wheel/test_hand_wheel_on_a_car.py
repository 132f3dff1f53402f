"""A hand wheel on a bus that speaks a car's dialect, and next to authenticated frames."""

from pathlib import Path

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_nodes
from steer_by_wire.closed_loop.pair.with_hand_wheel import with_hand_wheel
from steer_by_wire.controller.__main__ import main as controller
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.bus_language import read_language
from steer_by_wire.hand_wheel.__main__ import main
from steer_by_wire.hand_wheel.node import HandWheelNode
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.plant_emulator.__main__ import main as plant_emulator
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.node.end import End

CAR = Path(__file__).parents[1] / "dbc" / "dialect" / "my_car.toml"
KEPT = ("STEERING_FORCE", "HAND_WHEEL_STATE", "HAND_WHEEL_FEEDBACK", "HAND_WHEEL_STATUS")


def test_three_nodes_behind_gateways_drive_and_feel(tmp_path: Path) -> None:
    file = tmp_path / "car.toml"
    text = CAR.read_text().replace('"my_car.dbc"', f'"{CAR.parent / "my_car.dbc"}"', 1)
    file.write_text(f"keep = {[*KEPT]}\n{text}")
    language = read_language(file)
    kick = {"at_s": 0.5, "lasts_s": 1.0, "torque_n_m": 1.0}
    wheel = HandWheelSettings.model_validate({"driver": {"grip": "loose", "kicks": [kick]}})
    plant, law, wheel = with_hand_wheel(
        plant_preset("paper_nominal", ["duration_s=2", 'path={kind="straight"}']),
        controller_preset("practical_pd", ["hand_wheel.steered_by=driver"]),
        wheel,
    )
    node = HandWheelNode(wheel, 0)
    ends = (PlantNode(plant, 0), End.PLANT), (ControllerNode(law, 0), End.CONTROLLER), (node, None)
    edges = [language.at_edge(each, end, 0) for each, end in ends]
    run_virtual_nodes(edges[0], edges[1], None, None, lambda: False, others=edges[2:])
    report = edges[2].report()
    assert report["steered_by"] == "driver"
    assert report["mode"] == "active"  # the force came through
    assert report["dialect"]["sent"] == 0
    assert report["dialect"]["accepted"] > 50  # angle of the road wheels
    assert report["second_senders"] == []
    assert edges[0].report()["peak_m"] > 0.01


def test_a_dialect_without_its_messages_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--dialect", str(CAR)]) == ExitStatus.SETTINGS
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{CAR}: keep lacks {', '.join(KEPT)}, which no signal" in line


@pytest.mark.parametrize("program", [controller, plant_emulator])
def test_a_key_next_to_a_hand_wheel_is_refused(
    program: object, capsys: pytest.CaptureFixture[str]
) -> None:
    assert callable(program)
    assert program(["--set", "hand_wheel={}", "--key-file", "no.key"]) == ExitStatus.SETTINGS
    assert "--key-file: each end proves" in capsys.readouterr().err
