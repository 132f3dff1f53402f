"""``--check`` of the plant: what follows from its settings, without a bus."""

import tomllib

import pytest

from steer_by_wire.plant_emulator.command_line.program import check_text, main
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.settings import VehicleSettings
from steer_by_wire.plant_emulator.vehicle.steady_turn import understeer_gradient_s2_m
from steer_by_wire.runtime.settings import load_settings

LANE_CHANGE = ("path.kind=double_lane_change", "duration_s=10")
TOO_LITTLE = "TOO LITTLE for this path"


def checked(*overrides: str) -> str:
    return check_text(load_settings(PlantSettings, overrides=overrides))


def test_the_output_is_a_settings_file_again() -> None:
    settings = load_settings(PlantSettings, overrides=LANE_CHANGE)
    assert PlantSettings.model_validate(tomllib.loads(check_text(settings))) == settings


def test_a_manoeuvre_that_the_limits_forbid_is_said_before_it_is_driven() -> None:
    limited = [
        line
        for line in checked(*LANE_CHANGE, "vehicle.speed_m_s=16.7").splitlines()
        if TOO_LITTLE in line
    ]
    assert [line.split()[2] for line in limited] == ["lateral_acceleration", "lateral_jerk"]
    assert TOO_LITTLE not in checked()


def test_the_demand_on_a_circle_is_that_of_the_closed_form() -> None:
    text = checked("path.kind=circle", "path.radius_m=40", "vehicle.speed_m_s=10")
    vehicle = VehicleSettings(speed_m_s=10.0)
    wheelbase_m = vehicle.front_axle_distance_m + vehicle.rear_axle_distance_m
    steer_rad = (wheelbase_m + understeer_gradient_s2_m(vehicle) * 100.0) / 40.0
    assert "lateral acceleration 2.5 m/s²" in text
    assert f"steer to follow it   {steer_rad:.4g} rad, 0 rad within 0.5 s" in text


@pytest.mark.parametrize(
    ("speed_m_s", "verdict"), [(40.0, "below it: stable"), (50.0, "above it: UNSTABLE")]
)
def test_an_oversteering_vehicle_has_a_critical_speed(speed_m_s: float, verdict: str) -> None:
    text = checked(
        f"vehicle.speed_m_s={speed_m_s}", "vehicle.rear_cornering_stiffness_n_rad=130000"
    )
    (line,) = [line for line in text.splitlines() if "critical speed" in line]
    assert verdict in line


def test_the_program_checks_without_a_bus(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--check", "--interface", "socketcan", "--channel", "no_such"]) == 0
    printed = capsys.readouterr()
    assert "# Vehicle: 1.389 m/s (5 km/h):" in printed.out
    assert not printed.err
