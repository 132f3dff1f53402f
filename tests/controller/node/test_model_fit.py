"""Whether a vehicle is in the box of [validity], as its yaw rate shows: of runs at two speeds."""

from typing import Any

import pytest

from steer_by_wire import simulate

STIFF = ("front_cornering_stiffness_n_rad", 190e3), ("rear_cornering_stiffness_n_rad", 500e3)
SOFT = {f"plant.vehicle.{key}": 0.3 * value for key, value in STIFF}


def mass(virtual_mass_kg: float) -> dict[str, Any]:
    return {"plant.vehicle.virtual_mass_kg": virtual_mass_kg}


def report(preset: str, vehicle: dict[str, Any], noise_rad_s: float = 0.0) -> Any:
    plant = "highway_nominal" if preset.startswith("highway") else "paper_nominal"
    overrides = vehicle | {"plant.sensor_noise.yaw_rate_rad_s": noise_rad_s}
    return simulate(plant, preset, seed=1, duration_s=15.0, overrides=overrides).controller_report


@pytest.mark.parametrize("preset", ["highway_pd_ddob", "highway_predictor"])
@pytest.mark.parametrize("noise_rad_s", [0.0, 0.005])
@pytest.mark.parametrize(("vehicle", "fits"), [(mass(1600.0), True), (mass(5000.0), True)])
def test_the_ends_of_the_box_fit_and_their_mass_is_known(
    preset: str, noise_rad_s: float, vehicle: dict[str, Any], fits: bool
) -> None:
    found = report(preset, vehicle, noise_rad_s)
    assert found["model"]["fits"] is fits
    (mass_kg,) = vehicle.values()
    deviation_kg = found["model"]["virtual_mass_std_kg"]
    assert found["model"]["virtual_mass_kg"] == pytest.approx(mass_kg, abs=3.0 * deviation_kg)
    assert deviation_kg < 0.1 * mass_kg
    assert "model_misfit" not in found["validity_share"]


@pytest.mark.parametrize("preset", ["highway_pd_ddob", "highway_predictor"])
@pytest.mark.parametrize("vehicle", [mass(6000.0), SOFT], ids=["6000 kg", "stiffness -70 %"])
def test_a_vehicle_beyond_the_box_reads_model_misfit_and_asks_to_slow_down(
    preset: str, vehicle: dict[str, Any]
) -> None:
    found = report(preset, vehicle)
    assert not found["model"]["fits"]
    assert found["validity_share"]["model_misfit"] > 0.1


def test_at_walking_speed_the_mass_neither_shows_nor_matters() -> None:
    ordinary, heavy = (report("practical_pd_ddob", each) for each in (mass(2000.0), mass(6000.0)))
    for found in (ordinary, heavy):
        assert found["model"]["fits"]
        assert found["model"]["virtual_mass_kg"] is None
    assert heavy["measured_rms_m"] == pytest.approx(ordinary["measured_rms_m"], rel=0.05)
