"""The results of a study in its folder, read column by column: settings, factors, rows.

    study.json        what the results follow from
    results.parquet   the rows; of a study that is not complete yet, the files in chunks/

Only the requested columns are read, and texts as places in a list: a hundred thousand rows take a
few tens of megabytes.
"""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...plant_emulator.evaluation.run_verdict import Verdict
from ...runtime.array_types import BoolArray
from ...runtime.input_file import read_bytes
from ...runtime.settings import SettingsError
from .compiled_figures import HAND_WHEEL_COLUMNS
from .result_files import RESULTS, STUDY
from .row_file import check, pyarrow, read_table
from .study import Study, study_of_record
from .study_file import ReportSettings

Rows = Mapping[str, NDArray[Any]]
"""Columns of the results by name, as ``run_study`` returns them: those that a report needs."""
_READ = (
    *("id", "controller", "verdict", "rms_m", "peak_m", "settled_rms_m", "steer_rms_rad"),
    *("steer_rate_rms_rad_s", "limited_share", "grip_used_s", "fault_s", "reported_s"),
    *("reaction_s", "hand_wheel_shakes_hz", "felt_delay_s"),
)


def held(rows: Rows) -> BoolArray:
    """Return which runs hold the path."""
    return np.asarray(rows["verdict"] == Verdict.HOLDS)


def read_results(folder: Path) -> tuple[Study, Rows]:
    """Return the study whose results are in a folder, and the existing rows, sorted by id.

    Raises SettingsError, also where there are no rows.
    """
    file = folder / STUDY
    try:
        record = read_bytes(file)
    except OSError as error:
        raise SettingsError(
            f"{file}: cannot be read: {error.strerror}; give the folder of a study's results"
        ) from error
    for results in _files(folder):
        check(results, record)  # after this the record is as it was written
    study = study_of_record(str(file), record)
    study = study._replace(settings=study.settings.model_copy(update=_presentation(folder)))
    names = [name for name in _READ if name not in HAND_WHEEL_COLUMNS or study.hand_wheels]
    names += [factor.name for factor in study.factors]
    rows = _table([read_table(each, record, names) for each in _files(folder)], names)
    if not len(rows["id"]):
        raise SettingsError(f"{folder}: holds no results yet")
    return study, rows


def _table(tables: Sequence[Any], names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Return columns as arrays, sorted by id; texts as objects that share their strings."""
    arrow, _ = pyarrow()
    table = arrow.concat_tables(tables).sort_by("id")
    arrays: dict[str, NDArray[Any]] = {}
    for name in names:
        column = table[name]
        if arrow.types.is_string(column.type):
            coded = column.combine_chunks().dictionary_encode()
            words = np.array(coded.dictionary.to_pylist(), dtype=object)
            arrays[name] = words[coded.indices.to_numpy()]
        else:
            arrays[name] = column.to_numpy()
    return arrays


def _files(folder: Path) -> list[Path]:
    results = folder / RESULTS
    files = [results] if results.exists() else sorted((folder / "chunks").glob("*.parquet"))
    if not files:
        raise SettingsError(f"{folder}: holds no results yet")
    return files


def _presentation(folder: Path) -> dict[str, Any]:
    """Return what the report takes from the study file and no result depends on."""
    try:
        content = tomllib.loads(read_bytes(folder / "study.toml").decode())
        report = ReportSettings.model_validate(content.get("report", {}))
        return {"title": str(content.get("title", "")), "report": report}
    except (OSError, ValueError, RecursionError):
        return {}
