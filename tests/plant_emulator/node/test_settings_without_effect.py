"""Settings that had no effect in a run are said, and a run in which all act says nothing."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire import simulate
from steer_by_wire.plant_emulator.network.network import Network
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.node.settings_without_effect import settings_without_effect
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from steer_by_wire.plant_emulator.settings import PRESETS, PlantSettings, plant_preset
from steer_by_wire.runtime.settings import SettingsError, load_settings, preset_names

MOTION_S = 10.0


def warnings_of(*overrides: str, clamped: int = 0) -> list[str]:
    return found(load_settings(PlantSettings, overrides=overrides), MOTION_S, clamped)


def found(settings: PlantSettings, motion_s: float, clamped: int = 0) -> list[str]:
    path, traces_s = build_path(settings.path), Network(settings.latency, 0).traces_s
    driven_m = settings.vehicle.speed_m_s * motion_s
    return settings_without_effect(settings, path, traces_s, motion_s, driven_m, clamped)


@pytest.mark.parametrize("name", preset_names(PRESETS))
def test_a_whole_run_of_a_preset_has_no_warnings(name: str) -> None:
    settings = plant_preset(name)
    assert found(settings, settings.duration_s) == []


LATE = {
    "faults[0] (drop)": 'faults=[{{kind="drop",direction="uplink",onset_s={at_s}}}]',
    "disturbance.steps[0]": "disturbance.steps=[{{at_s={at_s},side_force_n=300}}]",
    "safety.override_at_s": "safety.override_at_s={at_s}",
    "latency.uplink.schedule[1]": (
        "latency.uplink.schedule=[{{time_s=0,mean_s=0.1}},{{time_s={at_s},mean_s=0.2}}]"
    ),
}


@pytest.mark.parametrize("what", LATE)
@given(at_s=st.floats(0.1, 100.0).map(lambda at_s: round(at_s, 3)))
def test_what_begins_after_the_end_of_the_motion_is_said_by_its_key(what: str, at_s: float) -> None:
    lines = warnings_of(LATE[what].format(at_s=at_s))
    assert bool(lines) == (at_s >= MOTION_S)
    assert all(line.startswith(f"{what} never acted, from {at_s:g} s on") for line in lines)


def test_a_trace_of_which_only_the_first_row_acted_is_said(tmp_path: Path) -> None:
    file = tmp_path / "trace.csv"
    for second_s, is_said in ((5.0, False), (10.0, True)):
        file.write_text(f"time_s,latency_s\n0,0.05\n{second_s},0.1\n")
        assert bool(warnings_of(f'latency.downlink.trace_file="{file.as_posix()}"')) == is_said


def test_a_trace_that_is_deleted_during_a_run_is_reported_as_read(tmp_path: Path) -> None:
    file = tmp_path / "trace.csv"
    file.write_text("time_s,latency_s\n0,0.05\n90,0.1\n")
    settings = load_settings(
        PlantSettings, overrides=[f'latency.uplink.trace_file="{file.as_posix()}"']
    )
    plant = PlantNode(settings.model_copy(update={"start_on_first_command": False}), 0)
    for now_ns in range(0, 1_000_000_001, settings.sensor_period_ns):
        plant.on_tick(now_ns)
    file.unlink()
    (line,) = [each for each in plant.report()["warnings"] if "trace" in each]
    assert "others from 90 s on: the motion ended at 1 s" in line


@pytest.mark.parametrize(
    ("last_m", "words"),
    [(9.0, "path ends after 9 m (6.48 s)"), (90.0, "path: only 13.89 m of its 90 m were driven")],
)
def test_a_path_that_is_shorter_or_longer_than_the_run_is_said(
    tmp_path: Path, last_m: float, words: str
) -> None:
    file = tmp_path / "path.csv"
    file.write_text(f"x_m,y_m\n0,0\n{last_m},0\n")
    (line,) = warnings_of(f'path={{kind="waypoints",file="{file.as_posix()}"}}')
    assert line.startswith(words)


def test_a_path_that_bends_more_than_the_steering_allows_is_said() -> None:
    assert warnings_of('path={kind="circle",radius_m=4.5}') == []
    (line,) = warnings_of('path={kind="circle",radius_m=3.5}')
    assert line.startswith("path asks for 0.8")
    assert "limit angle allows 0.7 rad" in line


@pytest.mark.parametrize("model", ["gamma", "lognormal"])
def test_a_spread_around_no_mean_and_a_model_without_one_are_said(model: str) -> None:
    keys = [f"latency.downlink.{key}" for key in (f"model={model}", "mean_s=1", "spread_s=1")]
    for left_out in ("mean_s", "spread_s"):
        (line,) = warnings_of(*(key for key in keys if left_out not in key))
        assert line.endswith(f"never varied: model {model} needs {left_out} too")
    assert warnings_of(*keys) == []


@pytest.mark.parametrize("given", [{"jitter_s": 0.02}, {"latencies": []}])
def test_python_refuses_a_latency_that_could_not_act(given: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match=r"^(jitter_s|latencies)"):
        simulate(duration_s=1.0, **given)


def test_clamped_values_are_counted() -> None:
    (line,) = warnings_of(clamped=2002)
    assert line.startswith("2002 measured values were beyond the range of their signal")


def test_a_run_reports_what_never_acted() -> None:
    never = {"plant.disturbance.steps": [{"at_s": 50.0}], "plant.latency.downlink.loss": 1.0}
    report = simulate(duration_s=3.0, overrides=never).plant_report
    assert report["warnings"] == [
        "disturbance.steps[0] never acted, from 50 s on: the motion ended at 3 s"
    ]
    assert report["verdict"] == "no start"
