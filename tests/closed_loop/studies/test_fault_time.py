"""The study of fault times: what it says of cases whose answer is known, and how it says it."""

import math
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_pair
from steer_by_wire.closed_loop.studies.fault_time import settings as file_settings
from steer_by_wire.closed_loop.studies.fault_time.longest_time import longest_time_s, plant_of
from steer_by_wire.closed_loop.studies.fault_time.settings import (
    Case,
    FallbackName,
    FaultName,
    FaultTimeSettings,
    cases_of,
    read_fault_time,
)
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.path.path import curvature
from steer_by_wire.plant_emulator.settings import plant_motion_params
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.study.__main__ import main
from steer_by_wire.tools.study.fault_time import lines_of, picture_of

SHIPPED = Path(file_settings.__file__).parent / "fault_time.toml"
SHORT = FaultTimeSettings(onset_s=2.0, watch_s=3.0, time_s_max=2.0, resolution_s=0.1)
SPEED_KM_H = 54.0
BEND_1_M = 2.0 / 15.0**2


def time_of(fault: FaultName, fallback: FallbackName, curvature_1_m: float = 0.0) -> float:
    return longest_time_s(SHORT, Case("", fault, fallback, SPEED_KM_H, curvature_1_m))


def test_silence_at_a_bend_leaves_a_ramp_no_time_and_a_path_a_second() -> None:
    assert time_of(FaultName.SILENCE, FallbackName.RAMP_TO_ZERO, BEND_1_M) == 0.0
    assert 1.0 <= time_of(FaultName.SILENCE, FallbackName.FOLLOW_AND_STOP, BEND_1_M) <= 1.5


def test_the_nodes_leave_their_lane_beyond_the_time_alone() -> None:
    case = Case("", FaultName.WRONG_SIGN, FallbackName.FOLLOW_PATH, SPEED_KM_H, BEND_1_M)
    longest_s = longest_time_s(SHORT, case)
    for time_s, stays in ((longest_s, True), (longest_s + SHORT.resolution_s, False)):
        plant = plant_of(SHORT, case, time_s)
        run = run_virtual_pair(plant, controller_preset(SHORT.controller_preset))
        assert (run.plant["node"]["beyond_lane_m"] <= 0.0) == stays


def test_a_wrong_sign_leaves_some_time_and_half_the_torque_any() -> None:
    """At 54 km/h on a straight road with a cross fall; half the motor still turns the wheels."""
    assert 0.0 < time_of(FaultName.WRONG_SIGN, FallbackName.FOLLOW_PATH) < math.inf
    assert time_of(FaultName.HALF_TORQUE, FallbackName.FOLLOW_PATH) == math.inf


def test_a_road_that_no_car_holds_has_no_time() -> None:
    assert math.isnan(time_of(FaultName.STUCK, FallbackName.KEEP, 15.0 / 15.0**2))


def test_the_fault_begins_where_the_bend_does() -> None:
    case = Case("", FaultName.STUCK, FallbackName.KEEP, SPEED_KM_H, BEND_1_M)
    plant = plant_of(SHORT, case, 0.4)
    (fault,) = plant.faults
    path, entry_m = plant_motion_params(plant).path, 15.0 * fault.onset_s
    assert curvature(path, entry_m - 0.1) == 0.0 < curvature(path, entry_m + 0.1)
    assert curvature(path, 15.0 * plant.duration_s) == pytest.approx(BEND_1_M)
    assert plant.safety.override_at_s == fault.onset_s + fault.duration_s


def test_the_shipped_file_has_the_scenes_and_all_faults() -> None:
    cases = list(cases_of(read_fault_time(SHIPPED)))
    scenes = {(c.road, c.speed_km_h, c.curvature_1_m) for c in cases if "GB 17675" in c.road}
    assert scenes == {("GB 17675, straight", 60.0, 0.0), ("GB 17675, R 35 m", 25.0, 1.0 / 35.0)}
    assert len(cases) == 14 * len(FaultName) * len(FallbackName)


def test_the_table_names_the_fallback_that_leaves_the_lane_last() -> None:
    settings = read_fault_time(SHIPPED)
    times = {
        case: (math.inf, 0.34, 0.0, math.nan)[tuple(FallbackName)[::-1].index(case.fallback)]
        for case in cases_of(settings)
    }
    lines = lines_of(settings, times)
    assert "at 80 km/h the fallback that leaves the lane last: follow_path and stop" in lines
    row = lines[lines.index("2 m/s², follow_path") + 2]
    assert row.split() == ["silence", *["0.34"] * 6]
    assert [axes.get_title(loc="left") for axes in picture_of(settings, times).axes][-1] == (
        "follow_path and stop\n2 m/s²"
    )


def test_a_car_without_a_rack_is_refused_in_a_line() -> None:
    case = Case("", FaultName.HALF_TORQUE, FallbackName.KEEP, 90.0, 0.0)
    with pytest.raises(SettingsError, match=r"weak_motor needs a table \[car\.rack\]"):
        plant_of(SHORT.model_copy(update={"plant": ()}), case, 0.4)


def test_the_program_writes_table_file_and_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "mine.toml"
    own.write_text(
        "[fault_time]\nspeeds_km_h = [30]\nbends_m_s2 = [0]\nfaults = ['stuck']\n"
        "fallbacks = ['keep']\nonset_s = 1\nwatch_s = 1\ntime_s_max = 0.2\n",
        encoding="utf-8",
    )
    out = tmp_path / "out"
    assert main([str(own), "--out", str(out), "--workers", "1"]) == 0
    assert "stuck" in capsys.readouterr().out
    assert (out / "fault_time.csv").read_text(encoding="utf-8").splitlines()[1] == (
        "straight,stuck,keep,30.0,0.0,inf"
    )
    assert (out / "fault_time.png").stat().st_size > 1000
    assert main([str(own), "--replay", "1"]) != 0
