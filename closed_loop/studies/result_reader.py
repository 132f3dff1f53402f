"""The results of a study in its folder, read column by column: settings, factors, rows.

    study.json        what the results follow from
    results.parquet   the rows; of a study that is not complete yet, the files in chunks/

Only the requested columns are read, and texts as places in a list: a hundred thousand rows take a
few tens of megabytes.
"""

import json
import math
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...plant_emulator.evaluation.run_verdict import Verdict
from ...runtime.array_types import BoolArray, FloatArray, IntArray
from ...runtime.input_file import read_bytes
from ...runtime.settings import SettingsError
from .compiled_figures import COLUMNS
from .result_files import RESULTS, STUDY
from .row_file import check, read_table
from .study_file import ReportSettings

VERDICTS = tuple(Verdict)
HOLDS = VERDICTS.index(Verdict.HOLDS)


class FactorRecord(NamedTuple):
    """A factor of the study; ``labels`` are empty where its values are drawn."""

    name: str
    keys: tuple[str, ...]
    labels: tuple[Any, ...]


class StudyRecord(NamedTuple):
    """The settings from which the results follow.

    ``content``  of study.json
    ``runs``     of the complete study
    """

    folder: Path
    content: bytes
    name: str
    title: str
    report: ReportSettings
    plant: Mapping[str, Any]
    controllers: Mapping[str, Mapping[str, Any]]
    sampling: Mapping[str, Any]
    verdict: Mapping[str, Any]
    factors: tuple[FactorRecord, ...]
    runs: int

    @property
    def names(self) -> tuple[str, ...]:
        """The controllers, in the order of the study."""
        return tuple(self.controllers)

    @property
    def reference(self) -> int:
        """The place of the controller that others are compared with: the first plain PD."""
        laws = [str(tables["law"]) for tables in self.controllers.values()]
        return laws.index("pd") if "pd" in laws else 0


class Rows(NamedTuple):
    """Columns of the results, one element a run; ``factors`` are numbers or places in a list.

    ``controller``, ``verdict``  places in ``StudyRecord.names`` and in ``VERDICTS``
    ``*rms_m``, ``*peak_m``      of the car
    ``case``                     the same for runs that differ in the controller only
    """

    id: IntArray
    case: IntArray
    controller: IntArray
    verdict: IntArray
    rms_m: FloatArray
    peak_m: FloatArray
    settled_rms_m: FloatArray
    steer_rms_rad: FloatArray
    steer_rate_rms_rad_s: FloatArray
    limited_share: FloatArray
    fault_s: FloatArray
    reported_s: FloatArray
    reaction_s: FloatArray
    factors: Mapping[str, NDArray[Any]]

    @property
    def holds(self) -> BoolArray:
        """Which runs hold the path."""
        return np.asarray(self.verdict == HOLDS)


_FIGURES = Rows._fields[4:-1]
"""The columns that are read as they are."""


def read_study(folder: Path) -> StudyRecord:
    """Return the record of the results in a folder; raises SettingsError."""
    file = folder / STUDY
    try:
        content = read_bytes(file)
    except OSError as error:
        raise SettingsError(
            f"{file}: cannot be read: {error.strerror}; give the folder of a study's results"
        ) from error
    for results in _files(folder):
        check(results, content)  # after this the record is as it was written
    record = json.loads(content)
    if [record.get("version"), record.get("columns")] != [
        version("steer-by-wire-emulator"),
        list(COLUMNS),
    ]:
        raise SettingsError(f"{file}: is not the record of a study of this version")
    factors = tuple(
        FactorRecord(name, tuple(keys), tuple(labels)) for name, keys, labels in record["levels"]
    )
    sampling, controllers = record["sampling"], record["controllers"]
    points = sampling["count"] or math.prod(len(factor.labels) for factor in factors)
    return StudyRecord(
        folder,
        content,
        record["name"],
        *_presentation(folder),
        record["plant"],
        controllers,
        sampling,
        record["verdict"],
        factors,
        runs=points * sampling["replicates"] * len(controllers),
    )


def read_rows(study: StudyRecord) -> Rows:
    """Return the columns of the existing rows, sorted by id; raises SettingsError for none."""
    factors = [factor.name for factor in study.factors]
    table = _table(study, ["id", "controller", "verdict", *_FIGURES, *factors])
    run = table["id"]
    if not len(run):
        raise SettingsError(f"{study.folder}: holds no results yet")
    return Rows(
        id=run,
        case=run // len(study.names),
        controller=_places(table["controller"], study.names),
        verdict=_places(table["verdict"], [str(verdict) for verdict in VERDICTS]),
        **{name: table[name] for name in _FIGURES},
        factors={name: table[name] for name in factors},
    )


def _table(study: StudyRecord, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Return columns as arrays, sorted by id; texts as objects that share their strings."""
    import pyarrow as pa

    tables = [read_table(file, study.content, names) for file in _files(study.folder)]
    table = pa.concat_tables(tables).sort_by("id")
    arrays: dict[str, NDArray[Any]] = {}
    for name in names:
        column = table[name]
        if pa.types.is_string(column.type):
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


def _places(words: NDArray[Any], known: Sequence[str]) -> IntArray:
    place = {word: index for index, word in enumerate(known)}
    return np.array([place[word] for word in words.tolist()], dtype=np.int64)


def _presentation(folder: Path) -> tuple[str, ReportSettings]:
    """Return what the report takes from the study file and no result depends on."""
    import tomllib

    try:
        content = tomllib.loads(read_bytes(folder / "study.toml").decode())
        report = ReportSettings.model_validate(content.get("report", {}))
        return str(content.get("title", "")), report
    except (OSError, ValueError, RecursionError):
        return "", ReportSettings()
