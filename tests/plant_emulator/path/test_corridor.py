"""The corridor of ISO 3888-1: its cones, the path between them, and a body that leaves it."""

import math
import re

import numpy as np
import pytest

from steer_by_wire import simulate
from steer_by_wire.plant_emulator.evaluation.report_in_words import verdict_text
from steer_by_wire.plant_emulator.path.corridor import (
    BETWEEN,
    body_outside,
    cones_and_body,
    corridor_of,
)
from steer_by_wire.plant_emulator.path.drivability import lateral_acceleration_m_s2
from steer_by_wire.plant_emulator.path.path import Pose, pose, vehicle_pose
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from steer_by_wire.plant_emulator.path.settings import CorridorSettings, StraightSettings
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.settings import SettingsError

WIDE = CorridorSettings(start_m=20.0, width_m=2.0, front_m=2.0, rear_m=3.0)
CORRIDOR = cones_and_body(WIDE)


def test_the_cones_stand_as_the_standard_says() -> None:
    sections = {section.number: section for section in CORRIDOR.sections}
    lengths_m = [(one.from_m - 20.0, one.to_m - 20.0) for one in sections.values()]
    assert lengths_m == [(0.0, 15.0), (45.0, 70.0), (95.0, 110.0), (110.0, 125.0)]
    widths_m = [one.left_m - one.right_m for one in sections.values()]
    assert widths_m == pytest.approx([2.45, 2.65, 2.85, 2.85])
    assert sections[3].right_m - sections[1].right_m == pytest.approx(3.5)
    assert sections[6].right_m == sections[5].right_m == sections[1].right_m
    assert corridor_of(StraightSettings()) is None


def test_a_body_is_outside_by_its_sides() -> None:
    assert body_outside(CORRIDOR, Pose(27.0, 0.0, 0.0)).outside_m == pytest.approx(-0.225)
    left = body_outside(CORRIDOR, Pose(27.0, -0.4, 0.0))
    assert left.outside_m == pytest.approx(0.175)
    assert (left.section, left.at_m) == (1, 9.0)  # of a side all along, its front
    assert body_outside(CORRIDOR, Pose(50.0, 9.0, 0.0)) == BETWEEN
    turned = body_outside(CORRIDOR, Pose(27.0, 0.0, 0.1))
    assert turned.outside_m == pytest.approx(3.0 * math.sin(0.1) + math.cos(0.1) - 1.225)
    assert turned.at_m == pytest.approx(4.0 + 3.0 * (1 - math.cos(0.1)) + math.sin(0.1), abs=0.01)


def test_a_cone_beside_a_body_counts_where_none_of_its_corners_is() -> None:
    """Half of it has passed the last cone of section 1, and turns left around it."""
    cone = body_outside(CORRIDOR, Pose(35.0, 0.3, 0.2))
    assert (cone.section, cone.at_m) == (1, 15.0)
    assert cone.outside_m == pytest.approx(0.3 + 1.0 / math.cos(0.2) - 1.225)


@pytest.mark.parametrize("settings", [CorridorSettings(), WIDE])
def test_the_path_leaves_half_of_the_free_space(settings: CorridorSettings) -> None:
    path, corridor = build_path(settings), cones_and_body(settings)
    worst = max(body_outside(corridor, pose(path, at)) for at in np.arange(0.0, 200.0, 0.5))
    free_m = 0.05 * settings.width_m + 0.125
    assert -0.6 * free_m < worst.outside_m <= -0.5 * free_m
    # A road without ice gives half of gravity: 60 km/h are driven with that.
    assert lateral_acceleration_m_s2(path, 60.0 / 3.6) < 0.5 * 9.81


def test_a_run_says_where_its_body_left_the_corridor() -> None:
    plant = plant_preset(
        "highway_nominal", ['path={kind="iso_3888_1",start_m=15}', "vehicle.speed_m_s=25"]
    )
    run = simulate(plant, "highway_pd", duration_s=11.6)
    text = verdict_text(run.plant_report)
    found = re.search(r"left the corridor at ([\d.]+) m \(section (\d)\) by ([\d.]+) (m?m)", text)
    assert found, text
    path, corridor = build_path(plant.path), corridor_of(plant.path)
    assert corridor is not None
    section = next(one for one in corridor.sections if one.number == int(found[2]))
    beyond_m = []
    for at_m, heading_rad, error_m in zip(
        run.plant.arc_length_m, run.plant.heading_error_rad, run.plant.lateral_error_m, strict=True
    ):
        body = vehicle_pose(path, at_m, heading_rad, error_m, plant.vehicle.preview_distance_m)
        # Points along both sides of the rectangle, a centimetre apart.
        along_m = np.arange(-corridor.rear_m, corridor.front_m, 0.01)
        for side_m in (-corridor.side_m, corridor.side_m):
            cos, sin = math.cos(body.heading_rad), math.sin(body.heading_rad)
            x_m = body.x_m + along_m * cos - side_m * sin
            y_m = body.y_m + along_m * sin + side_m * cos
            is_in = (section.from_m <= x_m) & (x_m <= section.to_m)
            off_m = np.maximum(y_m - section.left_m, section.right_m - y_m)[is_in]
            if len(off_m):
                place = int(np.argmax(off_m))
                beyond_m.append((float(off_m[place]), float(x_m[is_in][place]) - 15.0))
    worst_m, at_m = max(beyond_m)
    assert float(found[3]) * (1e-3 if found[4] == "mm" else 1.0) == pytest.approx(worst_m, abs=0.01)
    assert float(found[1]) == pytest.approx(at_m, abs=0.2)


def test_a_run_that_ends_within_the_corridor_is_refused() -> None:
    with pytest.raises(SettingsError) as refused:
        plant_preset("highway_nominal", ['path={kind="iso_3888_1"}', "duration_s=28"])
    told = "duration_s must be 28.8 or more: half for the corridor of ISO 3888-1, half for"
    assert told in str(refused.value)
    assert PlantSettings(path=CorridorSettings(), duration_s=1000.0).path == CorridorSettings()
