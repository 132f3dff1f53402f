"""Demands of a path on the tyres, and the line for a path that asks too much."""

import re

import pytest

from steer_by_wire.plant_emulator.path.drivability import lateral_acceleration_m_s2, undrivable
from steer_by_wire.plant_emulator.path.ellipse_and_lane_changes import circle, ellipse, straight
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from steer_by_wire.plant_emulator.path.settings import DoubleLaneChangeSettings, PathSettings
from steer_by_wire.plant_emulator.settings import PRESETS, PlantSettings
from steer_by_wire.runtime.settings import load_settings, preset_names, read_preset
from steer_by_wire.tools.run import __main__ as run


def test_a_path_asks_for_its_largest_curvature_times_the_speed_squared() -> None:
    assert lateral_acceleration_m_s2(straight(), 40.0) == 0.0
    assert lateral_acceleration_m_s2(circle(50.0), 10.0) == pytest.approx(2.0)
    # Most bent at the ends of the major axis: a/b².
    assert lateral_acceleration_m_s2(ellipse(60.0, 30.0), 5.0) == pytest.approx(25.0 * 60.0 / 900.0)


@pytest.mark.parametrize(("radius_m", "warns"), [(40.7, True), (40.9, False)])
def test_the_warning_begins_where_a_dry_road_ends(radius_m: float, *, warns: bool) -> None:
    assert bool(undrivable(circle(radius_m), 20.0)) == warns


def test_the_lane_change_of_iso_3888_1_as_a_path_is_no_road_for_60_km_h() -> None:
    path: PathSettings = DoubleLaneChangeSettings(kind="double_lane_change")
    line = undrivable(build_path(path), 60.0 / 3.6)
    assert "asks for a lateral acceleration of 12.2 m/s² at 16.67 m/s" in line
    assert "no car follows it" in line
    assert "\n" not in line


@pytest.mark.parametrize("name", preset_names(PRESETS))
def test_every_shipped_plant_is_driven_with_half_of_its_grip(name: str) -> None:
    """The virtual mass is the mass over the friction: 2000 kg on all of these roads."""
    plant = load_settings(PlantSettings, read_preset(PRESETS, name))
    friction = min(1.0, 2000.0 / plant.vehicle.virtual_mass_kg)
    if plant.car is not None:
        friction = plant.car.friction
    asked_m_s2 = lateral_acceleration_m_s2(build_path(plant.path), plant.vehicle.speed_m_s)
    assert asked_m_s2 <= 0.5 * friction * 9.81


def test_run_warns_of_a_path_that_no_car_follows(capsys: pytest.CaptureFixture[str]) -> None:
    fast = ('plant.path={kind="circle",radius_m=20}', "plant.vehicle.speed_m_s=15")
    run.main([*(word for each in fast for word in ("--set", each)), "--duration", "1"])
    asks = "the path asks for a lateral acceleration of 11.2"
    assert re.search(rf"^warning +{asks}", capsys.readouterr().out, re.MULTILINE)
    run.main(["--duration", "1"])
    assert "warning" not in capsys.readouterr().out
