"""Designs on a road: whose car drives there, and what the law believes of it."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from steer_by_wire.controller.analysis.check_figures import loop_around
from steer_by_wire.controller.analysis.loop_signals import LoopModel
from steer_by_wire.controller.analysis.periodic_loop import PeriodicLoop
from steer_by_wire.controller.filters.settings import VehicleModelSettings
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.network.settings import LatencySettings
from steer_by_wire.runtime.settings import SettingsError, load_settings
from steer_by_wire.tools.design import __main__ as design_gains
from steer_by_wire.tools.design.predictor_design import LoopFigures, Task, linear_figures
from steer_by_wire.tools.design.road import on_road, road_plants
from steer_by_wire.tools.design.specification import RoadTable, Specification
from steer_by_wire.tools.design.vehicle_file import load_vehicle
from steer_by_wire.tools.design.virtual_check import refuse_what_the_plant_does_not_drive
from tests.support.loops.shipped_design import SHIPPED
from tests.support.suite.same_process import same_process as same_process

ROAD = RoadTable(error_m_max=0.3, off_error_m_max=0.5)
SEDAN = SHIPPED / "sedan_vehicle.toml"
IDENTIFIED = """
[car]
front_relaxation_m = 0.6
[identified]
steering_ratio = 16
steering_offset_rad = 0
delay_and_lag_s = 0.07
lag_squared_s2 = 0.0009
yaw_rate_offset_rad_s = 0
"""


def test_the_car_of_the_file_drives_on_the_roads_of_the_study(tmp_path: Path) -> None:
    (tmp_path / "vehicle.toml").write_text(SEDAN.read_text() + IDENTIFIED)
    vehicle = on_road(ROAD, load_vehicle(tmp_path / "vehicle.toml"))
    assert vehicle.uncertainty.speed_m_s == pytest.approx((30.0 / 3.6, 100.0 / 3.6))
    plants = road_plants(ROAD, vehicle, LatencySettings(mean_s=0.1), 5.0, 0.01)
    assert len(plants) == 18
    for plant, mass_kg in zip(plants, [1750.0] * 9 + [2100.0] * 9, strict=True):
        assert plant.car is not None
        assert plant.vehicle.virtual_mass_kg == pytest.approx(mass_kg)
        assert (plant.car.front_relaxation_m, plant.car.tyre) == (0.6, "fiala")
        assert plant.latency.downlink.mean_s == 0.1
        # Lag and dead time as identified, the rest of the steering as in the study.
        assert plant.actuator.lag_s == pytest.approx(0.03 + 0.01)
        assert plant.actuator.dead_time_s == pytest.approx(0.04)
        assert plant.actuator.dead_band_rad == 0.0061
    assert {plant.car.friction for plant in plants if plant.car} == {0.3, 0.5, 1.0}


def test_a_folder_s_actuator_counts_before_the_lag_of_its_vehicle(tmp_path: Path) -> None:
    (tmp_path / "vehicle.toml").write_text(SEDAN.read_text() + IDENTIFIED)
    (tmp_path / "actuator.toml").write_text("[actuator]\nlag_s = 0.11\ndead_time_s = 0.03\n")
    vehicle = load_vehicle(tmp_path)
    assert vehicle.steering == {"lag_s": 0.11, "dead_time_s": 0.03}
    with ThreadPoolExecutor(1) as pool:
        spec = load_settings(Specification, None, SHIPPED / "road.toml")
        assert Task(pool, spec, vehicle).steering_s == (0.03, 0.11)
    (tmp_path / "vehicle.toml").unlink()
    with pytest.raises(SettingsError, match=r"vehicle\.toml"):
        load_vehicle(tmp_path)


@pytest.mark.parametrize(
    ("figure", "mistake"),
    [
        ("lag_squared_s2 = -0.001", "lag_squared_s2"),
        ("delay_and_lag_s = 3", "drive a corner: dead"),
    ],
)
def test_an_identified_steering_that_no_car_has_is_refused(
    tmp_path: Path, figure: str, mistake: str
) -> None:
    key = figure.partition(" ")[0]
    text = "\n".join(figure if key in line else line for line in IDENTIFIED.splitlines())
    (tmp_path / "car.toml").write_text(SEDAN.read_text() + text)
    spec = load_settings(Specification, None, SHIPPED / "road.toml")
    with pytest.raises(SettingsError, match=mistake):
        refuse_what_the_plant_does_not_drive(spec, load_vehicle(tmp_path / "car.toml"))
    with pytest.raises(SettingsError, match="two rising values above 0"):
        load_settings(
            Specification, None, SHIPPED / "road.toml", ["predictor.lag_margin_ms=[0, 9]"]
        )


@pytest.mark.usefixtures("same_process")
def test_a_design_on_a_road_reads_the_yaw_rate_and_believes_in_more_lag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(SEDAN), "--spec", str(SHIPPED / "road.toml"), "--out", str(tmp_path)]
    quick = ["predictor.seeds=1", "name=car", "course.duration_s=5", "predictor.delay_ms_max=100"]
    options = [option for each in quick for option in ("--set", each)]
    assert design_gains.main([*words, *options, "--minutes", "1e-6"]) == 0, capsys.readouterr()
    predictor, packet = (
        load_settings(ControllerSettings, None, tmp_path / f"car_{law}.toml")
        for law in ("predictor", "packet")
    )
    assert packet.law == "packet"
    assert "stopped before its end" in (tmp_path / "car_packet.toml").read_text(encoding="utf-8")
    assert packet.estimator == predictor.estimator
    assert predictor.estimator.yaw_rate_sensor_noise_rad_s is not None
    assert 0.08 <= predictor.estimator.actuator_lag_s <= 0.15  # the steering has 0.05
    assert predictor.followed_point == "centre_of_gravity"


def test_check_assumes_the_lag_that_a_design_is_judged_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settings = controller_preset("highway_predictor")
    vehicle, delay_ns = settings.nominal_model, 100_000_000
    assert isinstance(vehicle, VehicleModelSettings)
    checked = loop_around(settings, vehicle.vehicle)
    assert isinstance(checked, PeriodicLoop)
    believed = LoopModel(vehicle.vehicle, settings.estimator.actuator_lag_s)
    monkeypatch.setattr(Task, "loop_models", [believed])
    spec = load_settings(Specification, None, SHIPPED / "road.toml")
    with ThreadPoolExecutor(1) as pool:
        task = Task(pool, spec, load_vehicle(SEDAN))
        judged = linear_figures(task, settings, [delay_ns])
    assert judged == LoopFigures(
        checked.peak_sensitivity(delay_ns), checked.noise_gain_rad_m(delay_ns)
    )
