"""A study run from Python gives what the program stores, run by run."""

from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet

from steer_by_wire import SettingsError, run_study
from tests.support.small_study import STUDY, complete


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
