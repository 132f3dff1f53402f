"""Vehicles within and beyond the box of [validity], by their yaw rate in runs at two speeds."""

from itertools import product
from math import pi, sin
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire import simulate
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor
from steer_by_wire.runtime.settings import with_values
from tests.searches.ordinary_runs import alarm_in
from tests.support.suite.combinations import combined

STIFF = ("front_cornering_stiffness_n_rad", 190e3), ("rear_cornering_stiffness_n_rad", 500e3)
SOFT = {f"plant.vehicle.{key}": 0.3 * value for key, value in STIFF}


def mass(virtual_mass_kg: float) -> dict[str, Any]:
    return {"plant.vehicle.virtual_mass_kg": virtual_mass_kg}


@pytest.fixture
def winding(tmp_path: Path) -> dict[str, Any]:
    """Return a road that winds, with bends of up to 2.2 m/s² at 60 km/h."""
    points = (f"{x},{4.0 * sin(2.0 * pi * x / 140.0)}" for x in range(0, 600, 20))
    (tmp_path / "road.csv").write_text("\n".join(["x_m,y_m", *points]))
    return {
        "plant.path": {"kind": "waypoints", "file": str(tmp_path / "road.csv")},
        "plant.vehicle.speed_m_s": 60.0 / 3.6,
    }


def report(preset: str, overrides: dict[str, Any], duration_s: float = 14.0) -> Any:
    plant = "highway_nominal" if preset.startswith("highway") else "paper_nominal"
    run = simulate(plant, preset, seed=1, duration_s=duration_s, overrides=overrides)
    return run.controller_report


PRESETS = ("highway_pd_ddob", "highway_stiff_predictor")


@pytest.mark.parametrize(
    ("preset", "noise_and_mass"), combined(PRESETS, [*product([0.0, 0.005], [1600.0, 5000.0])])
)
def test_the_ends_of_the_box_fit_and_their_mass_is_known(
    preset: str, noise_and_mass: tuple[float, float], winding: dict[str, Any]
) -> None:
    noise_rad_s, mass_kg = noise_and_mass
    noise = {"plant.sensor_noise.yaw_rate_rad_s": noise_rad_s}
    found = report(preset, winding | mass(mass_kg) | noise)
    assert found["model"]["fits"]
    deviation_kg = found["model"]["virtual_mass_std_kg"]
    assert found["model"]["virtual_mass_kg"] == pytest.approx(mass_kg, abs=3.0 * deviation_kg)
    assert deviation_kg < 0.1 * mass_kg
    assert "model_misfit" not in found["validity_share"]


@pytest.mark.parametrize(("preset", "vehicle"), combined(PRESETS, [mass(6000.0), SOFT]))
def test_a_vehicle_beyond_the_box_reads_model_misfit_and_asks_to_slow_down(
    preset: str, vehicle: dict[str, Any], winding: dict[str, Any]
) -> None:
    found = report(preset, winding | vehicle)
    assert not found["model"]["fits"]
    assert found["validity_share"]["model_misfit"] > 0.1


@pytest.mark.parametrize(("mass_kg", "fits"), [(1280.0, True), (6000.0, True), (8000.0, False)])
def test_a_single_gentle_lane_change_shows_only_what_is_far_from_the_box(
    mass_kg: float, fits: bool
) -> None:
    fast = {"plant.vehicle.speed_m_s": 60.0 / 3.6}
    found = report("highway_stiff_predictor", fast | mass(mass_kg))["model"]
    assert found["fits"] is fits
    assert found["virtual_mass_kg"] == pytest.approx(mass_kg, rel=0.05)


def test_at_walking_speed_the_mass_neither_shows_nor_matters() -> None:
    ordinary, heavy = (
        report("practical_pd_ddob", each, 15.0) for each in (mass(2000.0), mass(6000.0))
    )
    for found in (ordinary, heavy):
        assert found["model"]["fits"]
        assert found["model"]["virtual_mass_kg"] is None
    assert heavy["measured_rms_m"] == pytest.approx(ordinary["measured_rms_m"], rel=0.05)


@pytest.mark.parametrize("seed", [7000072, 8000057])
def test_an_offset_that_is_steered_against_is_no_wrong_vehicle(seed: int) -> None:
    """Judged at any deviation, these two ordinary runs read *model does not fit*."""
    assert alarm_in(seed) == ""


@pytest.mark.parametrize("missing", [frozenset(), frozenset({"yaw_rate_rad_s"})])
def test_a_yaw_rate_that_no_message_carries_is_no_misfit(
    missing: frozenset[str], winding: dict[str, Any]
) -> None:
    absent = {"kind": "scale", "message": "VEHICLE_STATE", "signal": "yaw_rate_rad_s"}
    fault = {**absent, "magnitude": 0.0, "direction": "uplink"}
    plant = with_values(plant_preset("highway_nominal"), {"faults": [fault]}, "test")
    values = {key.removeprefix("plant."): value for key, value in winding.items()}
    law = controller_preset("highway_pd", ["supervision.stops_if_implausible=false"])
    pair = make_virtual_pair(with_values(plant, values, "test"), law)
    pair.controller.leave_out(missing)
    VirtualTimeExecutor((pair.edge, pair.controller)).run(12 * NS_PER_S)
    found = pair.controller.report()
    assert ("model_misfit" in found["validity_share"]) is (not missing)
    assert (found["model"] is None) is bool(missing)
