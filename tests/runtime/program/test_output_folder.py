"""The folder of ``--out``: of this run or new, never of another run."""

from pathlib import Path

import pytest

from steer_by_wire.runtime.program.output_folder import refuse_another_run
from steer_by_wire.runtime.settings import SettingsError


def test_a_folder_of_another_run_is_refused_and_one_of_this_run_is_not(tmp_path: Path) -> None:
    refuse_another_run(tmp_path / "new", {"plant.toml": "seed = 1\n"})
    (tmp_path / "plant.toml").write_text("seed = 1\n", encoding="utf-8")
    refuse_another_run(tmp_path, {"plant.toml": "seed = 1\n", "controller.toml": None})
    for text in ("seed = 2\n", None):
        with pytest.raises(SettingsError, match=r"another run, whose plant\.toml differs: give an"):
            refuse_another_run(tmp_path, {"plant.toml": text})
