"""The library: runs from Python, the same from both engines, and one line on errors."""

import doctest
import json
import re
import sys
from base64 import b64decode
from html import escape
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import steer_by_wire
from steer_by_wire import Mode, PlantSettings, Run, SettingsError, simulate
from steer_by_wire.controller.filters.settings import VehicleModelSettings
from steer_by_wire.plant_emulator.evaluation.report_in_words import verdict_text
from steer_by_wire.plant_emulator.path.settings import CircleSettings
from steer_by_wire.runtime.program.report import json_text
from steer_by_wire.tools.run.__main__ import main as run_closed_loop

NETWORK = {
    "plant.latency.downlink": {"model": "gamma", "mean_s": 0.08, "spread_s": 0.03, "loss": 0.02},
    "plant.latency.uplink.loss": 0.3,
    "plant.sensor_noise.lateral_error_m": 0.003,
}
NOT_COMPILED = {"uplink_latency_s", "side_slip_rad", "measured_m", "sample_age_s"}
TABLES = ("plant", "controller")


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(seed=5, duration_s=6.0, overrides=NETWORK)


@pytest.fixture(scope="module")
def compiled(run: Run) -> Run:
    return simulate(run.plant_settings, run.controller_settings, engine="compiled")


@pytest.mark.parametrize("side", TABLES)
def test_compiled_and_virtual_give_the_same_bits(run: Run, compiled: Run, side: str) -> None:
    virtual, other = getattr(run, side), getattr(compiled, side)
    for name in virtual._fields:
        assert getattr(other, name).shape == getattr(virtual, name).shape
        if name in NOT_COMPILED:
            assert np.isnan(getattr(other, name)).all()
            assert not np.isnan(getattr(virtual, name)).all()
        else:
            np.testing.assert_array_equal(getattr(other, name), getattr(virtual, name), name)


def test_a_run_shows_itself_in_one_line_with_its_error(run: Run) -> None:
    shown = repr(run)
    assert "\n" not in shown
    assert f"car RMS {1e3 * run.rms_m:.1f} mm off" in shown
    assert str(run.controller_settings.law) in shown


def test_a_notebook_shows_verdict_and_picture(
    run: Run, compiled: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = run._repr_html_()
    assert f"<b>{verdict_text(run.plant_report)}</b>" in shown
    picture = re.search('src="data:image/png;base64,([^"]+)"', shown)
    assert picture is not None
    assert b64decode(picture[1]).startswith(b"\x89PNG")
    assert "<b>complete</b>" in compiled._repr_html_()
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert f"<pre>{escape(repr(run))}</pre>" in run._repr_html_()


def test_both_tables_count_time_from_the_start_of_motion(run: Run) -> None:
    assert run.plant.time_s[[0, -1]] == pytest.approx([0.01, 6.0])
    assert run.controller.time_s[[0, -1]] == pytest.approx([0.0, 6.0])


def test_a_command_comes_into_effect_one_latency_after_it_was_sent() -> None:
    run = simulate(duration_s=1.0, overrides={"plant.latency.downlink.mean_s": 0.08})
    in_effect = run.plant.time_s > 0.085
    sent_rad = np.interp(run.plant.time_s - 0.08, run.controller.time_s, run.controller.sent_rad)
    np.testing.assert_allclose(run.plant.command_rad[in_effect], sent_rad[in_effect], atol=1e-5)
    assert np.ptp(sent_rad) > 0.01


def test_on_a_bus_with_a_bit_rate_the_first_command_takes_time() -> None:
    run = simulate(duration_s=0.5, bus={"bitrate_bit_s": 500_000})
    assert -1e-3 < run.controller.time_s[0] < 0.0
    assert set(run.controller.mode) == {Mode.ACTIVE}
    assert np.all(run.controller.sample_age_s < 0.02)


def test_on_a_bus_with_traffic_and_errors_the_run_is_that_of_the_program(tmp_path: Path) -> None:
    options = ["--load", "0.7", "--bit-error-rate", "1e-4"]
    assert run_closed_loop(["--duration", "1", *options, "--out", str(tmp_path)]) == 0
    run = simulate(duration_s=1.0, bus=tmp_path / "bus.toml")
    report = json.loads((tmp_path / "plant_emulator.json").read_text(encoding="utf-8"))
    assert json.loads(json_text(run.plant_report)) == report["node"]
    assert run.plant_report != simulate(duration_s=1.0).plant_report


def test_a_bus_that_is_too_slow_is_reported_in_one_line() -> None:
    with pytest.raises(ValueError, match=r"^bus: its bit rate is too low: [^\n]*$"):
        simulate(duration_s=15.0, bus={"bitrate_bit_s": 10_000})


def test_a_run_that_is_saved_can_be_made_again(run: Run, tmp_path: Path) -> None:
    run.save(tmp_path / "run")
    again = simulate(tmp_path / "run" / "plant.toml", str(tmp_path / "run" / "controller.toml"))
    np.testing.assert_array_equal(again.plant.lateral_error_m, run.plant.lateral_error_m)
    table = np.genfromtxt(tmp_path / "run" / "controller.csv", delimiter=",", names=True)
    assert table.dtype.names == run.controller._fields
    np.testing.assert_array_equal(table["sent_rad"], run.controller.sent_rad)


def test_a_saved_run_with_a_hand_wheel_can_be_made_again(tmp_path: Path) -> None:
    run = simulate("highway_nominal", "highway_pd", hand_wheel="hands_off", duration_s=1.0)
    run.save(tmp_path)
    files = [tmp_path / f"{name}.toml" for name in ("plant", "controller", "hand_wheel")]
    again = simulate(*files[:2], hand_wheel=files[2])
    assert run.hand_wheel is not None
    assert again.hand_wheel is not None
    np.testing.assert_array_equal(again.hand_wheel.angle_rad, run.hand_wheel.angle_rad)
    table = np.genfromtxt(tmp_path / "hand_wheel.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["angle_rad"], run.hand_wheel.angle_rad)


def test_settings_come_from_everywhere_and_the_nearest_wins() -> None:
    rig = PlantSettings(path=CircleSettings(radius_m=40.0), seed=9, duration_s=60.0)
    run = simulate(
        rig,
        "practical_pd",
        duration_s=np.float64(0.1),
        law="pd_dob",
        overrides={"controller.rate_hz": np.int64(50), "controller.dob": {"q_cutoff_rad_s": 2.0}}
        | {"controller.followed_point": "preview"}  # (19) has no centre of gravity
        | {"controller.nominal_model": {"kind": "paper_eq19"}},
    )
    assert run.plant_settings == rig.model_copy(update={"duration_s": 0.1})
    assert (run.controller_settings.law, run.controller_settings.rate_hz) == ("pd_dob", 50.0)
    path = CircleSettings(radius_m=20.0)
    assert simulate(duration_s=0.1, overrides={"plant.path": path}).plant_settings.path == path


def test_a_vehicle_file_is_the_vehicle_of_both() -> None:
    run = simulate(vehicle="tools/design/highway_vehicle.toml", duration_s=0.1)
    assert run.plant_settings.vehicle.speed_m_s == pytest.approx(45.0 / 3.6)
    model = run.controller_settings.nominal_model
    assert isinstance(model, VehicleModelSettings)
    assert model.model_dump(exclude={"kind"}) == run.plant_settings.vehicle.model_dump(
        include=set(VehicleModelSettings.model_fields) - {"kind"}
    )


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ({"plant": "papr_nominal"}, r"preset 'papr_nominal': .*\(did you mean paper_nominal\?\)"),
        ({"plant": "no.toml"}, r"no\.toml: cannot be read: No such file or directory"),
        ({"plant": 3}, r"plant is of type int \(allowed: name of a preset, path of a settings"),
        ({"vehicle": "no.toml"}, r"no\.toml: cannot be read: No such file or directory"),
        (
            {"vehicle": "tools/design/paper_vehicle.toml", "plant": PlantSettings()},
            "vehicle and plant of type PlantSettings: give one of the two",
        ),
        ({"seed": -1}, r"overrides of plant: seed = -1 .* \(allowed: integer from 0, up to"),
        (
            {"law": "pdd"},
            r'controller: law = "pdd" is not a known one \(did you mean pd\? allowed: pd,',
        ),
        ({"overrides": {"plant.sed": 1}}, r"sed is not a known key \(did you mean seed\?\)"),
        ({"overrides": {"hand_wheel.seed": 1}}, "hand_wheel.seed needs a hand_wheel"),
        ({"overrides": {"seed": 1}}, r"key seed starts with neither plant\. nor controller\."),
        ({"overrides": {"plant.seed": None}}, r"seed = None: settings have no such value"),
        (
            {"overrides": {"plant.path": 1, "plant.path.kind": "circle"}},
            r"overrides of plant: path is set to a value before",
        ),
        ({"engine": "fast"}, r"engine = 'fast' is not a known one \(allowed: virtual, compiled\)"),
        ({"engine": "compiled", "bus": {}}, r"bus: in a compiled run frames take no time"),
        ({"bus": {"load": 2.0}}, r"bus: load = 2\.0 should be less than or equal to 1\.5"),
        ({"bus": "no.toml"}, r"no\.toml: cannot be read: No such file or directory"),
        ({"bus": {"rest_bus": ["no.dbc"]}}, r"rest_bus: no\.dbc: No such file"),
    ],
)
def test_what_cannot_be_run_is_refused_in_one_line(arguments: dict[str, Any], line: str) -> None:
    with pytest.raises(SettingsError, match=line) as refused:
        simulate(**arguments)
    assert len(str(refused.value).splitlines()) == 1


def test_a_network_that_lets_nothing_through_ends_the_wait() -> None:
    with pytest.raises(ValueError, match="no command reached the plant within 60 s of the start"):
        simulate(overrides={"plant.latency.uplink.loss": 1.0, "controller.rate_hz": 10.0})


class _Frame:
    """Stands for a pandas.DataFrame."""

    def __init__(self, columns: dict[str, Any]) -> None:
        self.columns, self.index = dict(columns), ""

    def set_index(self, name: str) -> "_Frame":
        self.index = name
        return self


def test_tables_become_pandas_frames(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=_Frame))
    plant, controller = run.to_pandas()
    assert tuple(plant.columns) == run.plant._fields
    assert tuple(controller.columns) == run.controller._fields
    assert plant.index == controller.index == "time_s"


@pytest.mark.parametrize(
    ("missing", "method", "line"),
    [
        ("pandas", "to_pandas", r"^to_pandas\(\) needs pandas: pip install pandas$"),
        ("matplotlib", "plot", r"^plot\(\) needs matplotlib: pip install .*\[tools\]'$"),
    ],
)
def test_what_is_not_installed_is_named_in_one_line(
    run: Run, missing: str, method: str, line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    for module in ("run_drawing", "reports.plot_style"):
        monkeypatch.delitem(sys.modules, f"steer_by_wire.closed_loop.{module}", raising=False)
    with pytest.raises(ValueError, match=line):
        getattr(run, method)()


def test_a_run_is_drawn(run: Run, tmp_path: Path) -> None:
    figure = run.plot()
    figure.savefig(tmp_path / "run.png")
    error, *_ = figure.axes
    np.testing.assert_array_equal(error.lines[0].get_ydata(), 1e3 * run.plant.lateral_error_m)
    assert "RMS" in figure.get_suptitle()


def test_a_run_draws_its_error_into_axes_of_a_users_own() -> None:
    own = Figure()
    left, right = own.subplots(1, 2)
    run = simulate(duration_s=2.0)
    assert run.plot(left) is own
    (preview, cg, _zero), others = left.get_lines(), right.get_lines()
    assert list(preview.get_ydata()) == list(1e3 * run.plant.lateral_error_m)
    assert list(cg.get_ydata()) == list(1e3 * run.plant.cg_deviation_m)
    assert list(others) == []


def test_every_public_name_is_there_and_has_a_docstring() -> None:
    assert sorted(steer_by_wire.__all__) == steer_by_wire.__all__
    assert set(steer_by_wire.__all__) == set(steer_by_wire._MODULES)
    for name in steer_by_wire.__all__:
        assert getattr(steer_by_wire, name).__doc__
        assert name in dir(steer_by_wire)
    with pytest.raises(AttributeError, match="has no attribute 'simulat'"):
        _ = steer_by_wire.simulat


@pytest.mark.parametrize(
    "name",
    [
        "steer_by_wire",
        "steer_by_wire.closed_loop.scripting.check",
        "steer_by_wire.closed_loop.scripting.simulate",
        "steer_by_wire.closed_loop.studies.run_study",
        "steer_by_wire.plant_emulator.path.ellipse_and_lane_changes",
        "steer_by_wire.plant_emulator.path.waypoints",
    ],
)
def test_the_examples_of_the_docstrings_run(name: str) -> None:
    result = doctest.testmod(import_module(name), optionflags=doctest.ELLIPSIS)
    assert result.attempted > 0
    assert result.failed == 0
