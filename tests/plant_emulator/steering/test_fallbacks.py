"""The fallbacks of a car in a bend: which keep it in its lane, and which brake it."""

from collections.abc import Sequence
from itertools import pairwise

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.evaluation.report_in_words import verdict_text
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.settings import SettingsError

SILENCE = "{kind='drop', direction='downlink', message='STEERING_COMMAND', onset_s=2.0"


def after_silence(*overrides: str, fault: str = SILENCE + "}") -> PlantNode:
    """The plant behind a bend of 2 m/s² at 60 km/h, without commands from 2 s on."""
    bend = "path={kind='circle', radius_m=140}", "duration_s=12", f"faults=[{fault}]"
    pair = make_virtual_pair(
        plant_preset("bmw_320i", [*bend, *overrides]), controller_preset("highway_predictor")
    )
    pair.run()
    return pair.plant


def speeds_m_s(plant: PlantNode) -> Sequence[float]:
    """Return the speed along the path, of every tenth of a second."""
    places_m = [sample.arc_length_m for sample in plant.samples][::10]
    return [10.0 * (after_m - before_m) for before_m, after_m in pairwise(places_m)]


def test_a_ramp_to_zero_leaves_the_lane_and_a_path_does_not() -> None:
    assert after_silence("safety.fallback=ramp_to_zero").report()["beyond_lane_m"] > 5.0
    assert after_silence("safety.fallback=follow_path").report()["beyond_lane_m"] < -0.5


def test_a_fallback_that_stops_brakes_to_a_stand_along_the_path() -> None:
    """From 60 km/h at 4 m/s², half a second after the silence was found."""
    plant = after_silence("safety.fallback=follow_path", "safety.stop_m_s2=4.0")
    speeds = speeds_m_s(plant)
    assert speeds[-1] == 0.0
    assert speeds[45] - speeds[55] == pytest.approx(4.0, rel=0.03)
    assert plant.report()["beyond_lane_m"] < -0.5
    assert "the car did not go forward at the end" in verdict_text(plant.report())


def test_commands_that_come_back_end_the_braking() -> None:
    fault = SILENCE + ", duration_s=1.5}"
    plant = after_silence("safety.fallback=follow_path", "safety.stop_m_s2=4.0", fault=fault)
    speeds = speeds_m_s(plant)
    assert min(speeds) < 15.0
    assert speeds[-1] == pytest.approx(speeds[10], rel=0.01)
    assert "go forward" not in verdict_text(plant.report())


def test_the_linear_vehicle_cannot_brake() -> None:
    with pytest.raises(SettingsError, match=r"safety\.stop_m_s2 needs a table \[car\]"):
        plant_preset("highway_nominal", ["safety.stop_m_s2=4"])
