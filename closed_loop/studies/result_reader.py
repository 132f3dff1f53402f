"""The results of a study in its folder, read column by column: settings, factors, rows.

    study.json        what the results follow from
    results.parquet   the rows; of a study that is not complete yet, the files in chunks/

Only the requested columns are read, and texts as places in a list: a hundred thousand rows take a
few tens of megabytes.
"""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...plant_emulator.evaluation.run_verdict import Verdict
from ...runtime.array_types import BoolArray, FloatArray, IntArray
from ...runtime.input_file import read_bytes
from ...runtime.settings import SettingsError
from .result_files import RESULTS, STUDY
from .row_file import check, read_table
from .study import Study, study_of_record
from .study_file import ReportSettings

VERDICTS = tuple(Verdict)
HOLDS = VERDICTS.index(Verdict.HOLDS)


class Rows(NamedTuple):
    """Columns of the results, one element a run; ``factors`` are numbers or places in a list.

    ``controller``, ``verdict``  places in ``Study.names`` and in ``VERDICTS``
    ``*rms_m``, ``*peak_m``      of the car
    ``case``                     the same for runs that differ in the controller only
    ``hand_wheel_shakes_hz``, ``felt_delay_s``  None without a hand wheel
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
    grip_used_s: FloatArray
    fault_s: FloatArray
    reported_s: FloatArray
    reaction_s: FloatArray
    factors: Mapping[str, NDArray[Any]]
    hand_wheel_shakes_hz: FloatArray | None = None
    felt_delay_s: FloatArray | None = None

    @property
    def holds(self) -> BoolArray:
        """Which runs hold the path."""
        return np.asarray(self.verdict == HOLDS)


_FIGURES, _OF_WHEEL = Rows._fields[4:-3], Rows._fields[-2:]
"""The columns that are read as they are; the others of a study with a hand wheel."""


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
    factors = [factor.name for factor in study.factors]
    figures = (*_FIGURES, *_OF_WHEEL) if study.hand_wheels else _FIGURES
    names = ["id", "controller", "verdict", *figures, *factors]
    table = _table([read_table(each, record, names) for each in _files(folder)], names)
    run = table["id"]
    if not len(run):
        raise SettingsError(f"{folder}: holds no results yet")
    rows = Rows(
        id=run,
        case=run // len(study.names),
        controller=_places(table["controller"], study.names),
        verdict=_places(table["verdict"], [str(verdict) for verdict in VERDICTS]),
        **{name: table[name] for name in figures},
        factors={name: table[name] for name in factors},
    )
    return study, rows


def _table(tables: Sequence[Any], names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Return columns as arrays, sorted by id; texts as objects that share their strings."""
    import pyarrow as pa

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


def _presentation(folder: Path) -> dict[str, Any]:
    """Return what the report takes from the study file and no result depends on."""
    try:
        content = tomllib.loads(read_bytes(folder / "study.toml").decode())
        report = ReportSettings.model_validate(content.get("report", {}))
        return {"title": str(content.get("title", "")), "report": report}
    except (OSError, ValueError, RecursionError):
        return {}
