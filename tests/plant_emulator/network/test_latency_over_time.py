"""Latency over time: schedules and recorded traces, and the files that hold the latter."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.plant_emulator.network.latency_over_time import (
    LATENCY_S_MAX,
    Shape,
    Trace,
    profile_at,
    read_trace,
)
from steer_by_wire.runtime.settings import SettingsError

POINTS = (
    (1.0, 0.01, 0.001, 0.0),
    (2.0, 0.03, 0.003, 0.2),
    (2.0, 0.10, 0.000, 0.4),
    (4.0, 0.20, 0.010, 0.0),
)

every_shape = pytest.mark.parametrize("shape", Shape)


@pytest.mark.parametrize(
    ("time_s", "point"), [(1.0, 0), (1.5, 0), (1.999, 0), (2.0, 2), (3.9, 2), (4.0, 3)]
)
def test_a_step_holds_until_the_next_point(time_s: float, point: int) -> None:
    assert profile_at(POINTS, Shape.STEP, time_s) == POINTS[point]


def test_a_ramp_runs_straight_from_point_to_point() -> None:
    assert profile_at(POINTS, Shape.RAMP, 1.5) == pytest.approx((1.5, 0.02, 0.002, 0.1))
    assert profile_at(POINTS, Shape.RAMP, 2.5) == pytest.approx((2.5, 0.125, 0.0025, 0.3))


def test_two_points_at_one_time_are_a_step_in_a_ramp() -> None:
    before = profile_at(POINTS, Shape.RAMP, 2.0 - 1e-9)
    assert before[1:] == pytest.approx((0.03, 0.003, 0.2), abs=1e-6)
    assert profile_at(POINTS, Shape.RAMP, 2.0)[1:] == pytest.approx(POINTS[2][1:])


@every_shape
def test_the_ends_hold_outwards(shape: Shape) -> None:
    assert profile_at(POINTS, shape, 0.0) == POINTS[0]
    assert profile_at(POINTS, shape, 1e9) == POINTS[-1]
    assert profile_at(POINTS[:1], shape, 0.0) == profile_at(POINTS[:1], shape, 5.0) == POINTS[0]


@every_shape
@given(time_s=st.floats(0.0, 5.0))
def test_a_profile_stays_between_its_points(shape: Shape, time_s: float) -> None:
    found = profile_at(POINTS, shape, time_s)
    for value, column in zip(found[1:], list(zip(*POINTS, strict=True))[1:], strict=True):
        assert min(column) <= value <= max(column)


# Traces


def trace_file(directory: Path, content: str) -> Path:
    file = directory / "latency.csv"
    file.write_text(content, encoding="utf-8")
    return file


def test_a_trace_per_sample_starts_again_when_it_is_used_up(tmp_path: Path) -> None:
    trace = read_trace(trace_file(tmp_path, "latency_s\n0.01\n0.02\n0\n"))
    assert trace == Trace((0.01, 0.02, 0.0))
    assert [trace.latency_s(frame, 99.0) for frame in range(5)] == [0.01, 0.02, 0.0, 0.01, 0.02]


def test_a_trace_over_time_holds_each_row_until_the_next(tmp_path: Path) -> None:
    trace = read_trace(trace_file(tmp_path, "time_s,latency_s\n1,0.01\n2.5,0.02\n"))
    assert trace == Trace((0.01, 0.02), (1.0, 2.5))
    at = [(0.0, 0.01), (1.0, 0.01), (2.499, 0.01), (2.5, 0.02), (1e6, 0.02)]
    assert [trace.latency_s(7, time_s) for time_s, _ in at] == [latency_s for _, latency_s in at]


def test_the_longest_latency_is_allowed_and_no_longer_one(tmp_path: Path) -> None:
    assert read_trace(trace_file(tmp_path, f"latency_s\n{LATENCY_S_MAX}\n")).latencies_s == (10.0,)
    with pytest.raises(SettingsError, match="line 2: must be a latency from 0 to 10 s, or lost"):
        read_trace(trace_file(tmp_path, "latency_s\n10.001\n"))


@pytest.mark.parametrize("mark", ["", "lost", "nan", " Lost "])
def test_a_row_without_a_latency_is_a_loss(tmp_path: Path, mark: str) -> None:
    trace = read_trace(trace_file(tmp_path, f"time_s,latency_s\n0,0.05\n2,{mark}\n3,0.05\n"))
    assert trace.times_s == (0.0, 2.0, 3.0)
    assert [math.isnan(latency_s) for latency_s in trace.latencies_s] == [False, True, False]


def test_times_of_a_wall_clock_count_from_the_first_row(tmp_path: Path) -> None:
    file = trace_file(tmp_path, "time_s,latency_s\n1790000000.5,0.03\n1790000002.5,0.18\n")
    assert read_trace(file) == Trace((0.03, 0.18), (0.0, 2.0))


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", ": the first line must name the columns time_s,latency_s or latency_s"),
        ("0.01\n0.02\n", ", line 1: the first line must name the columns"),
        ("latency_s\n", ": holds no latencies"),
        ("latency_s\n0.01\nlate\n", ", line 3: must be a latency from 0 to 10 s, or lost"),
        ("latency_s\n0.01,0.02\n", ", line 2: has 2 cells, not 1"),
        ("latency_s\n-0.01\n", ", line 2: must be a latency"),
        ("latency_s\ninf\n", ", line 2: must be a latency"),
        ("time_s,latency_s\nsoon,0\n", ", line 2: must be a time_s from 0 up, not 'soon'"),
        ("time_s,latency_s\n0,0\n1,0\n1,0\n", ", line 4: time_s must rise, 1.0 follows 1.0"),
        ("latency_s\n" + "1" * 200_000 + "\n", ", line 2: must be a latency"),
    ],
)
def test_a_bad_trace_is_refused_in_one_line_that_names_the_place(
    tmp_path: Path, content: str, complaint: str
) -> None:
    file = trace_file(tmp_path, content)
    with pytest.raises(SettingsError) as caught:
        read_trace(file)
    assert str(caught.value).startswith(f"{file}{complaint}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"latency_s\n\xff\n", None])
def test_a_trace_that_cannot_be_read_is_refused(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "latency.csv"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(SettingsError, match=r"is not UTF-8 text|cannot be read"):
        read_trace(file)
