"""One vehicle file serves plant, controller, design and studies, in one spelling."""

from pathlib import Path

import pytest

from steer_by_wire.closed_loop.identification.vehicle_file import IdentifiedSettings
from steer_by_wire.closed_loop.studies.study import load_study
from steer_by_wire.controller import settings as controller
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator import settings as plant
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.settings import VehicleSettings
from steer_by_wire.runtime.settings import SettingsError, load_settings, read_preset
from steer_by_wire.tools.design.vehicle_file import VehicleFile
from tests.support.loops.baseline_runs import vehicle_of

SHIPPED = Path(__file__).parents[3] / "tools" / "design" / "highway_vehicle.toml"
PRESET = read_preset("steer_by_wire.controller.presets", "practical_pd_ddob")


def test_plant_controller_and_design_read_the_same_vehicle() -> None:
    rig = load_settings(PlantSettings, shared=plant.shared_vehicle(SHIPPED)).vehicle
    law = load_settings(ControllerSettings, PRESET, shared=controller.shared_vehicle(SHIPPED))
    designed = load_settings(VehicleFile, file=SHIPPED).vehicle
    values = designed.vehicle._asdict()
    assert rig.model_dump(include=set(values)) == values
    assert vehicle_of(law).vehicle == designed.vehicle
    assert rig.speed_m_s != VehicleSettings().speed_m_s


def test_a_car_in_the_file_makes_the_plant_that_car(tmp_path: Path) -> None:
    file = tmp_path / "vehicle.toml"
    known = dict.fromkeys(IdentifiedSettings.model_fields, 0.0)
    identified = "".join(f"{key} = {value}\n" for key, value in known.items())
    text = f"{SHIPPED.read_text()}[car]\nfriction = 0.7\n[identified]\n{identified}"
    file.write_text(text)
    settings = load_settings(PlantSettings, shared=plant.shared_vehicle(file))
    assert settings.car is not None
    assert settings.car.friction == 0.7
    assert load_settings(VehicleFile, file=file).vehicle.speed_m_s == 12.5


def test_the_command_line_is_above_the_vehicle_file() -> None:
    settings = load_settings(
        ControllerSettings,
        PRESET,
        overrides=["nominal_model.virtual_mass_kg=1234"],
        shared=controller.shared_vehicle(SHIPPED),
    )
    assert vehicle_of(settings).virtual_mass_kg == 1234.0
    assert vehicle_of(settings).speed_m_s == 12.5


def test_a_study_takes_the_vehicle_for_its_plant_and_its_controllers(tmp_path: Path) -> None:
    (tmp_path / "vehicle.toml").write_text(SHIPPED.read_text())
    (tmp_path / "study.toml").write_text(
        'name = "one"\n[base]\nvehicle = "vehicle.toml"\ncontrollers = ["practical_pd"]\n'
        '[[factors]]\nkey = "plant.latency.downlink.mean_s"\nvalues = [0.0]\n'
    )
    study = load_study(tmp_path / "study.toml")
    assert study.plant["vehicle"]["speed_m_s"] == 12.5
    assert study.controllers["practical_pd"]["nominal_model"]["speed_m_s"] == 12.5


@pytest.mark.parametrize(
    ("text", "mistake"),
    [
        ("[uncertainty]\n", r"vehicle\.toml: has no table \[vehicle\]"),
        ("[vehicle]\nmass = 3\n", r"vehicle\.toml: vehicle\.mass is not a known key"),
    ],
)
def test_a_file_without_a_vehicle_is_refused_in_one_line(
    tmp_path: Path, text: str, mistake: str
) -> None:
    file = tmp_path / "vehicle.toml"
    file.write_text(text)
    with pytest.raises(SettingsError, match=f"{mistake}[^\n]*$"):
        load_settings(PlantSettings, shared=plant.shared_vehicle(file))
