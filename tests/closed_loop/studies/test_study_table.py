"""A study run from Python gives what the program stores, run by run."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyarrow import parquet

from steer_by_wire import SettingsError, run_study, simulate, sweep
from tests.support.runs.small_study import STUDY, complete


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
    assert [list(level) for level in levels] == [
        [0.0, 0.08, 0.2],
        [0.0, 0.4],
        ["practical_ellipse", "straight"],
    ]


def test_a_study_file_that_cannot_be_run_is_refused_in_one_line(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text(STUDY.replace("mean_s", "mean"), encoding="utf-8")
    with pytest.raises(SettingsError, match=r"study\.toml: .*latency\.downlink\.mean "):
        run_study(file)
    with pytest.raises(SettingsError, match=r"no\.toml: cannot be read"):
        run_study("no.toml")


ALIKE: dict[str, Any] = {"controller": "practical_pid", "duration_s": 3.0, "latency_s": 0.1}


def test_a_sweep_has_a_row_for_every_combination_and_each_is_the_run_of_simulate() -> None:
    table = sweep(
        {
            "latency_s": np.array([0.0, 0.1]),
            "jitter_s": [0.0, 0.02],
            "controller": ["practical_pd", "practical_pid"],
        },
        replicates=2,
        duration_s=3.0,
        overrides={"controller.rate_hz": 50},
    )
    assert {len(column) for column in table.values()} == {2 * 2 * 2 * 2}
    row = int(
        np.flatnonzero(
            (table["controller"] == "practical_pid")
            & (table["latency_s"] == 0.1)
            & (table["jitter_s"] == 0.0)
        )[0]
    )
    run = simulate(
        controller="practical_pid",
        duration_s=3.0,
        latency_s=0.1,
        overrides={"controller.rate_hz": 50},
        engine="compiled",
    )
    assert table["rms_m"][row] == run.rms_m
    alike = sweep({}, controller="practical_pid", duration_s=3.0, latency_s=0.1, jitter_s=0.02)
    assert alike["rms_m"][0] == sweep({"jitter_s": [0.02]}, **ALIKE)["rms_m"][0]
    listed = {"latencies": [0.1] * 400, "duration_s": 3.0}
    (by_list,) = sweep({}, **listed)["rms_m"]
    assert by_list == simulate(**listed, engine="compiled").rms_m
    assert len(np.unique(table["rms_m"])) > len(np.unique(table["rms_m"][table["jitter_s"] == 0]))


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
        ({"over": {"plant": ["paper_nominal"]}}, r"sweep over plant: takes one; sweep over keys"),
        ({"over": {}, "latencies": []}, "latencies: holds none"),
        ({"over": {}, "overrides": {"sed": 1}}, r"key sed starts with neither plant\. nor"),
    ],
)
def test_a_sweep_that_cannot_be_run_is_refused_in_one_line(arguments: Any, line: str) -> None:
    with pytest.raises(SettingsError, match=line) as refused:
        sweep(**arguments)
    assert len(str(refused.value).splitlines()) == 1
