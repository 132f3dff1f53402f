"""The pair in virtual time: every tool builds it in one place, so that all honour its faults."""

import json
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair, run_virtual_pair
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.faults.settings import FaultKind, FaultSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.settings.toml_text import dump_toml
from steer_by_wire.tools.run.__main__ import main as closed_loop

ROOT = Path(__file__).parents[3]
LOST = FaultSettings(kind=FaultKind.DROP, direction="uplink", message="LATERAL_ERROR", onset_s=0.5)


@pytest.fixture(scope="module")
def plant() -> PlantSettings:
    return PlantSettings(duration_s=1.0, faults=(LOST,))


@pytest.fixture(scope="module")
def controller() -> ControllerSettings:
    return controller_preset("practical_pd")


def test_no_tool_makes_a_plant_of_its_own() -> None:
    found = {
        file.relative_to(ROOT).as_posix()
        for folder in ("closed_loop", "tools")
        for file in (ROOT / folder).rglob("*.py")
        if "PlantNode(" in file.read_text(encoding="utf-8")
    }
    assert found == {"closed_loop/pair/virtual_pair.py"}


def test_a_pair_meets_the_faults_of_its_settings(
    plant: PlantSettings, controller: ControllerSettings
) -> None:
    result = run_virtual_pair(plant, controller, None)
    (reported,) = result.plant["node"]["faults"]
    assert reported["changed"] > 0
    assert result.controller["node"]["holds"] == 1


def test_a_pair_without_faults_has_no_stage_for_them(controller: ControllerSettings) -> None:
    pair = make_virtual_pair(PlantSettings(duration_s=0.2), controller, 3, 2)
    assert pair.edge is pair.plant
    pair.run()
    assert (len(pair.plant.samples), len(pair.controller.samples)) == (3, 2)


def test_the_closed_loop_meets_them(plant: PlantSettings, tmp_path: Path) -> None:
    settings = tmp_path / "plant.toml"
    settings.write_text(dump_toml(plant), encoding="utf-8")
    assert closed_loop([str(settings), "--ideal-wire", "--out", str(tmp_path)]) == 0
    report = json.loads((tmp_path / "plant_emulator.json").read_text(encoding="utf-8"))
    assert report["node"]["faults"][0]["changed"] > 0
