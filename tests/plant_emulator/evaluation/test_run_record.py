"""Record of a run: places in the world, figures, and the trace file."""

import csv
import math
from pathlib import Path as FilePath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.plant_emulator.evaluation.held_figures import HeldRules
from steer_by_wire.plant_emulator.evaluation.run_record import (
    PlacedSample,
    PlantSample,
    RunningFigures,
    place,
    write_trace,
)
from steer_by_wire.plant_emulator.evaluation.run_verdict import Peaks
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from steer_by_wire.plant_emulator.path.settings import CircleSettings, StraightSettings

ROAD = build_path(StraightSettings())
CIRCLE = build_path(CircleSettings(radius_m=50.0))


def sample(arc_length_m: float, lateral_error_m: float, command_rad: float = 0.125) -> PlantSample:
    place_m, turns = (arc_length_m, lateral_error_m), (0.5, -0.1, command_rad, 0.1)
    return PlantSample(0.25, *place_m, *turns, 0.08, math.nan, 0.02, 0.0, 0.3)


def test_on_a_straight_road_left_of_the_path_is_up() -> None:
    assert place(ROAD, sample(3.0, 0.5)) == pytest.approx((3.0, 0.5, 3.0, 0.0))


def test_on_a_circle_to_the_left_a_quarter_turn_ends_at_its_side() -> None:
    quarter_m = 50.0 * math.pi / 2.0
    assert place(CIRCLE, sample(quarter_m, 2.0)) == pytest.approx((0.0, 48.0, 0.0, 50.0), abs=1e-9)


@given(st.floats(0.0, 1000.0), st.floats(-20.0, 20.0))
def test_a_sample_is_its_lateral_error_away_from_the_path(
    arc_length_m: float, lateral_error_m: float
) -> None:
    placed = place(CIRCLE, sample(arc_length_m, lateral_error_m))
    distance_m = math.hypot(placed.x_m - placed.path_x_m, placed.y_m - placed.path_y_m)
    assert distance_m == pytest.approx(abs(lateral_error_m), abs=1e-9)
    # To the left, where the centre of the circle is: the origin.
    assert math.hypot(placed.x_m, placed.y_m) == pytest.approx(50.0 - lateral_error_m)


# Figures


def test_figures_by_hand() -> None:
    figures = RunningFigures(HeldRules(settled_after=2))
    assert figures.held.preview_rms_m == 0.0
    figures.add(1.0, 2.0, 3.0, 0.1, "")
    figures.add(-7.0, -14.0, -9.0, -0.3, "")
    assert math.isnan(figures.peaks_m.settled_m)
    figures.add(5.0, 10.0, -6.0, 0.2, "")
    assert figures.peaks_m._replace(outside_m=0.0) == Peaks(9.0, 6.0, 0.0)
    held = figures.held
    assert held.samples == 3
    assert held.preview_rms_m == pytest.approx(5.0)
    assert held.preview_peak_m == 7.0
    assert (held.final_m, held.judged_final_m) == (10.0, -6.0)
    assert held.rms_m == pytest.approx(10.0)
    assert held.peak_m == 14.0
    assert held.wheel_angle_peak_rad == 0.3


# The trace file


def rows_of(file: FilePath) -> list[dict[str, str]]:
    with file.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_a_trace_holds_every_digit_of_every_sample(tmp_path: FilePath) -> None:
    file = tmp_path / "trace.csv"
    samples = [sample(0.1 * number, math.sin(number)) for number in range(20)]
    write_trace(file, CIRCLE, samples)
    rows = rows_of(file)
    assert list(rows[0]) == [*PlantSample._fields, *PlacedSample._fields]
    assert len(rows) == 20
    for row, written in zip(rows, samples, strict=True):
        columns = {**written._asdict(), **place(CIRCLE, written)._asdict()}
        for name, value in columns.items():
            assert row[name] == ("" if math.isnan(value) else repr(value))


def test_what_has_no_value_yet_is_empty(tmp_path: FilePath) -> None:
    file = tmp_path / "trace.csv"
    write_trace(file, ROAD, [sample(0.0, 0.0, command_rad=math.nan)])
    (row,) = rows_of(file)
    assert [name for name, cell in row.items() if not cell] == ["command_rad", "uplink_latency_s"]


def test_a_trace_without_samples_is_a_header(tmp_path: FilePath) -> None:
    file = tmp_path / "trace.csv"
    write_trace(file, ROAD, [])
    assert len(file.read_text(encoding="utf-8").splitlines()) == 1
