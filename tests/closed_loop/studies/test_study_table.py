"""A study run from Python gives what the program stores, run by run."""

import json
import random
from inspect import signature
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyarrow import parquet

from steer_by_wire import SettingsError, run_study, simulate, sweep
from steer_by_wire.closed_loop.studies.compiled_figures import HAND_WHEEL_COLUMNS
from steer_by_wire.controller.laws.pd import LAW
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.path.settings import StraightSettings
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.settings import preset_names
from steer_by_wire.runtime.settings.toml_text import dump_toml
from tests.support.runs.small_study import complete


def test_the_columns_are_those_that_are_stored(tmp_path: Path) -> None:
    stored = parquet.read_table(complete(tmp_path).results)
    table = run_study(tmp_path / "study.toml")
    assert {len(column) for column in table.values()} == {stored.num_rows} == {48}
    shared = [name for name in table if name in stored.column_names]
    assert {"controller", "replicate", "verdict", "rms_m"} <= set(shared)
    for name in shared:
        np.testing.assert_array_equal(
            table[name], stored[name].to_numpy(zero_copy_only=False), err_msg=name
        )
    levels = np.unique(table["mean_s"]), np.unique(table["jitter"]), np.unique(table["road"])
    roads = ["practical_ellipse", "straight"]
    assert [list(level) for level in levels] == [[0.0, 0.08, 0.2], [0.0, 0.4], roads]


def test_a_sweep_takes_what_simulate_takes() -> None:
    of_sweep, of_simulate = (dict(signature(each).parameters) for each in (sweep, simulate))
    assert set(of_sweep) - {"over", "replicates"} == set(of_simulate)
    for name, parameter in of_simulate.items():
        if name not in ("seed", "engine"):  # of all replicates; compiled unless there is a bus
            assert of_sweep[name].annotation == parameter.annotation, name
            assert of_sweep[name].default == parameter.default, name


FAULT = {"kind": "drop", "direction": "uplink", "onset_s": 0.5, "duration_s": 0.1}
KINDS: dict[str, dict[str, Any]] = {
    "presets": {"plant": "paper_corner_a", "controller": "practical_pid"},
    "settings": {
        "plant": plant_preset("paper_corner_b", ["latency.downlink.loss=0.1"]),
        "controller": controller_preset("practical_pd", ["rate_hz=50"]),
    },
    "files": {"plant": "plant.toml", "controller": Path("controller.toml")},
    "vehicle": {"vehicle": "vehicle.toml", "controller": "practical_predictor"},
    "law": {"law": LAW, "latency_s": np.float64(0.1)},
    "network": {"latency_s": 0.1, "jitter_s": 0.02, "loss": 0.1},
    "latencies": {"latencies": np.linspace(0.0, 0.2, 50)},
    "overrides": {
        "overrides": {
            "plant.path": StraightSettings(),
            "controller.law": LAW,
            "plant.vehicle.initial_lateral_error_m": 0.1,
            "controller.rate_hz": 50,
        }
    },
    "sensors": {"controller": "practical_predictor", "overrides": {"plant.sensor_period_ms": 20.0}},
    "faults": {"engine": "virtual", "overrides": {"plant.faults": [FAULT]}},
    "bus": {"engine": "virtual", "bus": {"load": 0.7}},
    "hand wheel": {"hand_wheel": "two_point", "overrides": {"hand_wheel.cycle_ms": 5}},
    "hand wheel on a bus": {"hand_wheel": "still", "engine": "virtual", "bus": {"load": 0.3}},
    "bus in a file": {"engine": "virtual", "bus": "bus.toml"},
    "bus as settings": {"engine": "virtual", "bus": BusSettings(bitrate_bit_s=250_000)},
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_row_of_a_sweep_is_the_run_of_simulate(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in {
        "plant.toml": "[vehicle]\nspeed_m_s = 1.5\n[latency.downlink]\nmean_s = 0.05\n",
        "controller.toml": dump_toml(controller_preset("practical_pd", ["rate_hz=50"])),
        "vehicle.toml": f"[vehicle]\n{dump_toml(plant_preset('paper_corner_c').vehicle)}",
        "bus.toml": "bitrate_bit_s = 125_000\n",
    }.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    given = {"duration_s": 2.0, **KINDS[kind]}
    table = sweep({}, seed=7, **given)
    run = simulate(seed=int(table["seed"][0]), **{"engine": "compiled", **given})
    figures = ("rms_m", "peak_m", "preview_rms_m", "preview_peak_m")
    assert [table[name][0] for name in figures] == [getattr(run, name) for name in figures]
    assert table["steer_peak_rad"][0] == np.max(np.abs(run.controller.sent_rad))
    assert table["law"][0] == run.controller_settings.law
    assert run.rms_m > 0.0


@pytest.mark.parametrize("engine", ["compiled", "virtual"])
def test_rows_with_a_hand_wheel_are_runs_of_simulate(engine: Any) -> None:
    draw, given = random.Random(61), {"plant": "highway_nominal", "controller": "highway_pd"}
    fixed = {"controller.hand_wheel.steered_by": "driver", "plant.latency.downlink.mean_s": 0.03}
    over: dict[str, Any] = {
        "hand_wheel": draw.sample(preset_names("steer_by_wire.hand_wheel.presets"), 2),
        "hand_wheel.feedback.law": ["rack_force", draw.choice(["spring", "model", "cdob"])],
        "hand_wheel.feedback.torque_gradient_n_m": [draw.uniform(2.0, 20.0)],
        "hand_wheel.wheel.friction_n_m": [0.0],
        "hand_wheel.cycle_ms": [draw.choice([2.0, 5.0, 10.0])],
        "plant.latency.uplink.mean_s": [0.01 * draw.randrange(5), 0.2],
    }
    table = sweep(over, overrides=fixed, duration_s=4.0, engine=engine, **given)
    assert set(table["hand_wheel_verdict"]) == {"still", "shakes"}
    for place, text in enumerate(table["overrides"]):
        row, own = {name: table[name][place] for name in table}, json.loads(text)
        own |= fixed | {"plant.duration_s": 4.0}
        run = simulate(hand_wheel=own.pop("hand_wheel"), overrides=own, engine=engine, **given)
        report = run.hand_wheel_report
        expected = run.rms_m, report["shakes_at_hz"] or nan, report["amplitude_rad"] or nan
        found = [row[key] for key in ("rms_m", *HAND_WHEEL_COLUMNS[:2])]
        np.testing.assert_array_equal(found, expected)
        assert report["verdict"].startswith(row["hand_wheel_verdict"])
        if row["hand_wheel_feedback_law"] == "rack_force":
            assert row["felt_delay_s"] == pytest.approx(0.03 + row["mean_s"])


def test_a_sweep_judges_by_the_thresholds_of_its_plant() -> None:
    narrow = {"plant.verdict.road_m": 0.001}
    assert sweep({}, duration_s=5.0)["verdict"][0] == "holds"
    assert sweep({}, duration_s=5.0, overrides=narrow)["verdict"][0] == "left road"
    for engine in ("compiled", "virtual"):
        assert sweep({}, duration_s=0.5, engine=engine)["verdict"][0] == "too short"


def test_a_sweep_goes_over_lists_too() -> None:
    lists = [[0.0], np.array([0.0, 0.2])]
    table = sweep({"latencies": lists}, duration_s=2.0)
    assert table["rms_m"].tolist() == [
        simulate(latencies=each, duration_s=2.0, engine="compiled").rms_m for each in lists
    ]


def test_a_sweep_has_a_row_for_every_combination() -> None:
    own = controller_preset("practical_pd")
    table = sweep(
        {
            "latency_s": np.array([0.0, 0.1]),
            "jitter_s": [0.0, 0.02],
            "controller": ["practical_pid", own, controller_preset("practical_pd", ["rate_hz=50"])],
        },
        replicates=2,
        duration_s=2.0,
    )
    assert {len(column) for column in table.values()} == {2 * 2 * 3 * 2}
    assert set(table["controller"]) == {"practical_pid", "pd 2", "pd 3"}
    late = (table["latency_s"] == 0.1) & (table["controller"] == "pd 2")
    fixed = sweep({"controller": [own]}, latency_s=0.1, jitter_s=0.02, duration_s=2.0)
    assert fixed["rms_m"][0] == table["rms_m"][late & (table["jitter_s"] == 0.02)][0]
    network = {"latency_s": 0.1, "jitter_s": 0.02}
    named = sweep({"controller": [own]}, overrides=network, duration_s=2.0)
    assert named["rms_m"][0] == fixed["rms_m"][0]
    assert len(np.unique(table["rms_m"][late])) == 3


@pytest.mark.parametrize(
    ("over", "columns"),
    [
        ({"law": ["pd", "pd_dob"]}, {"controller_law"}),
        ({"duration_s": [1.0, 2.0]}, {"plant_duration_s"}),
        (
            {"plant.latency.uplink.loss": [0.1], "loss": [0.0, 0.1]},
            {"plant_latency_uplink_loss", "plant_latency_downlink_loss"},
        ),
    ],
)
def test_a_sweep_names_its_columns_so_that_none_is_taken(over: Any, columns: set[str]) -> None:
    assert columns <= set(
        sweep(over, overrides={} if "duration_s" in over else {"duration_s": 1.0})
    )


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ({"over": {"plant.sed": [1]}}, r"sweep: factor sed: .*sed"),
        ({"over": {"loss": [2.0]}}, r"loss = 2\.0 should be less than or equal to 1"),
        ({"over": {"controller": ["practical_p"]}}, r"practical_p.*did you mean practical_pd"),
        ({"over": "x"}, "sweep: takes values by name, as "),
        ({"over": {"controller": "practical_pd"}}, "sweep over controller: takes a list of values"),
        ({"over": {"latency_s": 0.1}}, r"sweep over latency_s: takes a list of values, not 0\.1"),
        ({"over": {"latency_s": [0.1]}, "latency_s": 0.2}, "given as an argument too; leave one"),
        ({"over": {"loss": [0.1, nan]}}, r"^sweep: factors\[0\].values\[1\] = NaN cannot[^\n]*$"),
        ({"over": {"plant": ["paper_nominal"]}}, r"sweep over plant: takes one; sweep over keys"),
        ({"over": {}, "latencies": []}, "latencies: holds none"),
        ({"over": {}, "overrides": {"sed": 1}}, r"key sed starts with neither plant\. nor"),
        ({"over": {"plant.verdict.road_m": [1.0]}}, "sweep: plant.verdict is for single runs"),
        ({"over": {}, "overrides": {"plant.faults": [FAULT]}}, "faults: "),
        ({"over": {"hand_wheel.cycle_ms": [1]}}, "factor cycle_ms: .* needs a hand wheel: add"),
        ({"over": {"hand_wheel": ["sill"]}}, r"preset 'sill': .*did you mean still"),
        ({"over": {}, "engine": "compiled", "bus": {"load": 0.7}}, "bus: in a compiled run"),
        ({"over": {"bus": [{}]}}, r"sweep over bus: takes one; sweep over keys, as bus\.table"),
        ({"over": {}, "engine": "fast"}, r"engine = 'fast' is not a known one"),
        ({"over": {}, "jitter_s": 0.02}, "jitter_s = 0.02: needs a latency_s"),
        ({"over": {"law": [LAW._replace()]}}, "sweep: a Law has no name at the top of a module"),
    ],
)
def test_a_sweep_that_cannot_be_run_is_refused_in_one_line(arguments: Any, line: str) -> None:
    with pytest.raises(SettingsError, match=line) as refused:
        sweep(**arguments)
    assert len(str(refused.value).splitlines()) == 1
