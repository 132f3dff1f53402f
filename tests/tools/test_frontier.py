"""The frontier: designs meet what they are compared at, and runs confirm their errors."""

import csv
import json
from pathlib import Path

import pytest

from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.laws.assembly import design_law
from steer_by_wire.runtime.settings import SettingsError, load_settings, read_preset
from steer_by_wire.tools.design.candidate import controller_settings
from steer_by_wire.tools.design.frontier.frontier import Row, compute, write_csv
from steer_by_wire.tools.design.frontier.settings import STRUCTURES, FrontierSettings
from steer_by_wire.tools.design.frontier.sweep import specification_for
from steer_by_wire.tools.design.frontier.trials import with_map, worst_rms_m
from steer_by_wire.tools.design.vehicle_file import VehicleFile

QUICK = (
    "delays_ms=[160, 250]",
    "trials.seeds=2",
    "search.generations=12",
    "course.duration_s=30",
)


def asked(*overrides: str) -> FrontierSettings:
    preset = read_preset("steer_by_wire.tools.design.frontier", "frontier")
    return load_settings(FrontierSettings, preset, overrides=(*QUICK, *overrides))


def vehicle() -> VehicleFile:
    return load_settings(VehicleFile, read_preset("steer_by_wire.tools.design", "paper_vehicle"))


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Row]]:
    folder = tmp_path_factory.mktemp("frontier")
    names = ("PD", "PD + map", "PID")
    return {name: compute(asked(), vehicle(), name, folder, lambda _: None) for name in names}


@pytest.mark.parametrize("structure", ["PD", "PD + map", "PID"])
def test_each_design_meets_the_demands_that_make_the_comparison_fair(
    rows: dict[str, list[Row]], structure: str
) -> None:
    assert [row.point.delay_ms for row in rows[structure]] == [160.0, 250.0]
    for point, _ in rows[structure]:
        assert point.noise_gain_rad_m <= 3.2
        assert point.peak_sensitivity <= 2.9
        assert point.margin_ms >= 1.3 * point.delay_ms


@pytest.mark.parametrize("structure", ["PD", "PD + map", "PID"])
def test_the_error_of_the_linear_analysis_is_that_of_runs(
    rows: dict[str, list[Row]], structure: str
) -> None:
    law, takes_map = STRUCTURES[structure]
    point, _ = rows[structure][-1]
    spec = specification_for(asked(), law, point.delay_ms)
    settings = controller_settings(spec, vehicle(), law, point.values)
    run_m = worst_rms_m(asked(), vehicle(), with_map(settings, takes_map), point.delay_ms)
    # The linear worst is over all delays up to the longest, the runs' over both ends.
    assert run_m == pytest.approx(point.rms_m, rel=0.03)


def test_the_margin_is_where_a_corner_becomes_unstable(rows: dict[str, list[Row]]) -> None:
    point, _ = rows["PID"][-1]
    spec = specification_for(asked(), "pid", point.delay_ms)
    design = design_law(controller_settings(spec, vehicle(), "pid", point.values))
    loops = [SampledLoop(design, model, spec.period_ns) for model in vehicle().models]
    before_ns, after_ns = (round(1e6 * (point.margin_ms + step)) for step in (-1.0, 1.0))
    assert all(loop.is_stable(before_ns) for loop in loops)
    assert not all(loop.is_stable(after_ns) for loop in loops)


def test_an_integral_buys_accuracy_at_the_same_noise(rows: dict[str, list[Row]]) -> None:
    """The sentence of the front page: a PID leaves a tenth of the error of a retuned PD."""
    for pd, pid in zip(rows["PD"], rows["PID"], strict=True):
        assert pid.point.rms_m < 0.1 * pd.point.rms_m


def test_what_is_there_is_not_computed_again_and_other_settings_are(tmp_path: Path) -> None:
    first = compute(asked(), vehicle(), "predictor", tmp_path, lambda _: None)
    file = tmp_path / "predictor.json"
    kept = json.loads(file.read_text())
    kept["rows"][0]["point"]["rms_m"] = 7.0
    file.write_text(json.dumps(kept))
    assert compute(asked(), vehicle(), "predictor", tmp_path, lambda _: None)[0].point.rms_m == 7.0
    file.write_text(file.read_text()[:100])
    again = compute(asked(), vehicle(), "predictor", tmp_path, lambda _: None)
    assert [row.trials for row in again] == [row.trials for row in first]
    other = compute(asked("trials.seeds=1"), vehicle(), "predictor", tmp_path, lambda _: None)
    assert other[0].point.rms_m != 7.0


def test_the_table_has_a_line_for_each_structure_and_delay(
    rows: dict[str, list[Row]], tmp_path: Path
) -> None:
    write_csv([row for each in rows.values() for row in each], tmp_path / "frontier.csv")
    with (tmp_path / "frontier.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [(line["structure"], line["delay_ms"]) for line in lines[:2]] == [
        ("PD", "160"),
        ("PD", "250"),
    ]
    assert "k_p=" in lines[0]["values"]


def test_delays_must_ascend() -> None:
    with pytest.raises(SettingsError, match="delays_ms must be above 0 and ascend"):
        asked("delays_ms=[250, 160]")
