"""Whatever vehicle and specification a user writes: presets, or lines that say why not."""

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.runtime.settings.toml_text import _toml_table
from steer_by_wire.tools.design import __main__ as design_gains
from tests.support.suite.same_process import same_process as same_process

EXAMPLES = 6
"""In the suite; ``--hypothesis-profile=explore`` draws others."""
LINEAR = ("pd", "pid", "pd_dob", "pd_cdob", "pd_ddob")
PATHS: tuple[dict[str, Any], ...] = (
    {"kind": "straight"},
    {"kind": "circle", "radius_m": 30.0},
    {"kind": "ellipse"},
    {"kind": "single_lane_change", "length_m": 60.0},
    {"kind": "double_lane_change"},
)
_ONE_GENERATION_MINUTES = 1e-6
"""A search begins at least one."""
Draw = Callable[[st.SearchStrategy[Any]], Any]


def test_a_wrong_vehicle_is_answered_with_vehicles_alone(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        design_gains.main(["road", "--spec", "road"])
    assert "one of highway_vehicle, paper_vehicle, sedan_vehicle\n" in capsys.readouterr().err


def between(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers evenly on a logarithmic axis, with four digits."""
    exponents = st.floats(0.0, 1.0, allow_nan=False)
    return exponents.map(lambda share: float(f"{low * (high / low) ** share:.4g}"))


@st.composite
def vehicles(draw: Draw) -> dict[str, Any]:
    vehicle = {
        "virtual_mass_kg": draw(between(300.0, 40_000.0)),
        "yaw_inertia_kg_m2": draw(between(300.0, 300_000.0)),
        "front_cornering_stiffness_n_rad": draw(between(2e4, 1e6)),
        "rear_cornering_stiffness_n_rad": draw(between(2e4, 1e6)),
        "front_axle_distance_m": draw(between(0.5, 5.0)),
        "rear_axle_distance_m": draw(between(0.5, 5.0)),
        "preview_distance_m": draw(between(0.1, 20.0)),
        "speed_m_s": draw(between(0.5, 40.0)),
    }
    names = draw(st.lists(st.sampled_from(sorted(vehicle)), max_size=3, unique=True))
    share = draw(between(0.01, 0.9))
    ranges = {
        name: [vehicle[name] * (1.0 - share), vehicle[name] * (1.0 + share)] for name in names
    }
    return {"vehicle": vehicle, "uncertainty": ranges}


@st.composite
def specifications(draw: Draw) -> dict[str, Any]:
    laws = draw(
        st.lists(st.sampled_from([*LINEAR, "predictor"]), min_size=1, max_size=2, unique=True)
    )
    spec: dict[str, Any] = {
        "name": "drawn",
        "laws": laws,
        "rate_hz": draw(between(10.0, 1000.0)),
        "dob_q_kind": draw(st.sampled_from(["order_2", "type_2"])),
        "peak_sensitivity_max": draw(between(1.05, 50.0)),
        "noise_gain_rad_m_max": draw(between(0.01, 1000.0)),
        "delay": {
            "ms_max": draw(st.one_of(st.just(0.0), between(1.0, 500.0))),
            "step_ms": draw(between(10.0, 100.0)),
            "margin_ms": draw(st.one_of(st.just(0.0), between(1.0, 200.0))),
        },
        "d_stability": {
            "settling_1_s": draw(between(0.001, 5.0)),
            "cone_angle_deg": draw(st.floats(91.0, 179.0)),
            "bandwidth_rad_s": draw(between(0.01, 100.0)),
        },
        "course": {
            "duration_s": draw(between(0.5, 5.0)),
            "paths": draw(st.lists(st.sampled_from(PATHS), min_size=1, max_size=2)),
        },
        "search": {"starts": 1, "generations": draw(st.integers(1, 2))},
        "predictor": {
            "fallback": "practical_pd_ddob",
            "generations": 1,
            "delay_ms_max": draw(between(1.0, 500.0)),
            "delay_step_ms": 250.0,
            "conditions": [{"mean_ms": draw(between(1.0, 300.0)), "error_m_max": 0.5}],
        },
    }
    if draw(st.booleans()):
        spec["actuator"] = {"lag_s": draw(between(0.001, 5.0)), "delay_ms_max": 50.0}
    if draw(st.booleans()):
        spec["rms_m_max"] = {"pd": draw(between(1e-3, 10.0))}
    if draw(st.booleans()):
        spec["jitter"] = [{"mean_ms": draw(between(1.0, 200.0)), "spread_ms": 10.0, "loss": 0.1}]
    return spec


@pytest.mark.usefixtures("same_process")
@settings(max_examples=EXAMPLES)
@given(vehicle=vehicles(), spec=specifications())
def test_any_specification_ends_with_presets_or_one_line_for_each_law(
    vehicle: dict[str, Any], spec: dict[str, Any]
) -> None:
    with TemporaryDirectory() as name:
        outcome_of(vehicle, spec, _ONE_GENERATION_MINUTES, Path(name))


def outcome_of(vehicle: dict[str, Any], spec: dict[str, Any], minutes: float, folder: Path) -> int:
    """Design, and check what the user sees; returns the exit status."""
    for file, tables in (("vehicle", vehicle), ("spec", spec)):
        (folder / f"{file}.toml").write_text("\n".join(_toml_table(tables, ())))
    command = [str(folder / "vehicle.toml"), "--spec", str(folder / "spec.toml")]
    errors, printed = io.StringIO(), io.StringIO()
    with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(printed):
        status = design_gains.main([*command, "--out", str(folder), "--minutes", str(minutes)])
    refused = [line for line in errors.getvalue().splitlines() if "error: " in line]
    if status == 2:
        assert len(refused) == 1
        return status
    presets = {law for law in spec["laws"] if (folder / f"drawn_{law}.toml").exists()}
    without = set(spec["laws"]) - presets
    assert status == bool(without)
    assert {line.partition("error: ")[2].partition(":")[0] for line in refused} == without
    for kept in folder.glob("drawn_*.toml"):
        if not kept.name.endswith(("_plant.toml", "_specification.toml")):
            load_settings(ControllerSettings, None, kept)
            is_unmet = kept.name.endswith(".unmet.toml")
            assert kept.read_text().startswith("# NOT A DESIGN") == is_unmet
    return status
