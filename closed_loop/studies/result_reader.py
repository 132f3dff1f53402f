"""The results of a study in its folder, read column by column: settings, factors, rows.

    study.json        what the results follow from
    results.parquet   the rows; of a study that is not complete yet, the files in chunks/

Only the requested columns are read, and texts as places in a list: a hundred thousand rows take a
few tens of megabytes.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...plant_emulator.evaluation.run_verdict import Verdict
from ...runtime.array_types import BoolArray, FloatArray, IntArray
from ...runtime.settings import SettingsError
from .compiled_figures import COUNTS
from .factors import Design
from .result_files import RESULTS, are_numbers, cause_line, overrides_of, read_columns, read_json
from .scenario import Case, Pair, Scenarios
from .study import Study
from .study_file import ReportSettings, StudySettings

VERDICTS = tuple(Verdict)
HOLDS = VERDICTS.index(Verdict.HOLDS)


class FactorRecord(NamedTuple):
    """A factor of the study; ``labels`` are empty where its values are drawn."""

    name: str
    keys: tuple[str, ...]
    labels: tuple[Any, ...]


class StudyRecord(NamedTuple):
    """The settings from which the results follow.

    ``scenarios``  makes settings of overrides, as the study did; it does not know its points
    ``runs``       of the complete study
    """

    folder: Path
    name: str
    title: str
    report: ReportSettings
    plant: Mapping[str, Any]
    controllers: Mapping[str, Mapping[str, Any]]
    sampling: Mapping[str, Any]
    verdict: Mapping[str, Any]
    factors: tuple[FactorRecord, ...]
    scenarios: Scenarios
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

    def replay(self, run: int) -> str:
        """Return the command that repeats a run."""
        return (
            f"steer-by-wire study {self.folder / 'study.toml'} --out {self.folder} --replay {run}"
        )


class Rows(NamedTuple):
    """Columns of the results, one element a run; ``factors`` are numbers or places in a list.

    ``controller``, ``verdict``  places in ``StudyRecord.names`` and in ``VERDICTS``
    ``*rms_m``, ``*peak_m``      of the preview point; those with ``cg`` of the centre of gravity
    ``case``                     the same for runs that differ in the controller only
    """

    id: IntArray
    case: IntArray
    controller: IntArray
    verdict: IntArray
    rms_m: FloatArray
    peak_m: FloatArray
    settled_rms_m: FloatArray
    cg_rms_m: FloatArray
    cg_peak_m: FloatArray
    settled_cg_rms_m: FloatArray
    duration_s: FloatArray
    latency_mean_s: FloatArray
    steer_rms_rad: FloatArray
    steer_rate_rms_rad_s: FloatArray
    limited_share: FloatArray
    factors: Mapping[str, NDArray[Any]]

    @property
    def holds(self) -> BoolArray:
        """Which runs hold the path."""
        return np.asarray(self.verdict == HOLDS)


_FIGURES = (
    "rms_m", "peak_m", "settled_rms_m", "cg_rms_m", "cg_peak_m", "settled_cg_rms_m", "duration_s",
    "latency_mean_s", "steer_rms_rad", "steer_rate_rms_rad_s", "limited_share",
)  # fmt: skip
"""The columns that are read as they are."""


def read_study(folder: Path) -> StudyRecord:
    """Return the record of the results in a folder; raises SettingsError."""
    file = folder / "study.json"
    try:
        record = read_json(file)
        settings = StudySettings.model_validate(
            {
                "name": record["name"],
                "base": {"controllers": list(record["controllers"])},
                "sampling": record["sampling"],
                "verdict": record["verdict"],
            }
        )
        factors = tuple(_factor(*level) for level in record["levels"])
        plant, controllers = _settings(record["plant"], record["controllers"])
    except SettingsError:
        raise
    except OSError as error:
        raise SettingsError(
            f"{file}: cannot be read: {error.strerror}; give the folder of a study's results"
        ) from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        what = f"is not the record of a study of this version: {cause_line(error)}"
        raise SettingsError(f"{file}: {what}") from error
    title, report = _presentation(folder)
    design, bus = Design((), 1, None), record.get("bus")
    scenarios = Scenarios(Study(str(file), settings, plant, controllers, design, bus=bus))
    points = settings.sampling.count or int(np.prod([len(f.labels) for f in factors], initial=1))
    return StudyRecord(
        folder=folder,
        name=settings.name,
        title=title,
        report=report,
        plant=plant,
        controllers=controllers,
        sampling=settings.sampling.model_dump(mode="json"),
        verdict=settings.verdict.model_dump(mode="json"),
        factors=factors,
        scenarios=scenarios,
        runs=points * settings.sampling.replicates * len(controllers),
    )


def _settings(plant: Any, controllers: Mapping[str, object]) -> tuple[Any, dict[str, Any]]:
    """Return the tables of the plant and of each controller, checked; raises ValueError."""
    checked: dict[str, Any] = {}
    # These name a car's messages, and its file may be elsewhere.
    faults = plant["faults"]
    plant = {**plant, "faults": []}
    for name, tables in controllers.items():
        text = json.dumps({"plant": plant, "controller": tables})
        pair = Pair.model_validate_json(text, strict=True)
        dumped = pair.model_dump(mode="json", exclude_none=True)
        plant, checked[name] = dumped["plant"], dumped["controller"]
    return {**plant, "faults": faults}, checked


def _factor(name: object, keys: object, labels: object) -> FactorRecord:
    """Return a factor of the record; raises TypeError for anything else."""
    if not (isinstance(name, str) and isinstance(keys, list) and isinstance(labels, list)):
        raise TypeError("a factor is a name, keys and labels")
    if not all(isinstance(key, str) for key in keys):
        raise TypeError("the keys of a factor are texts")
    if not all(isinstance(label, str | int | float) for label in labels):
        raise TypeError("the labels of a factor are texts and numbers")
    return FactorRecord(name, tuple(keys), tuple(labels))


def read_rows(study: StudyRecord) -> Rows:
    """Return the columns of the existing rows, sorted by id; raises SettingsError for none."""
    names = [factor.name for factor in study.factors]
    table = _table(study.folder, _types(study))
    run = table["id"]
    if len(np.unique(run)) < len(run) or np.any((run < 0) | (run >= study.runs)):
        raise SettingsError(f"{study.folder}: holds rows of runs that this study does not have")
    rows = Rows(
        id=run,
        case=run // len(study.names),
        controller=_places(study, table, "controller", study.names),
        verdict=_places(study, table, "verdict", [str(verdict) for verdict in VERDICTS]),
        **{name: table[name] for name in _FIGURES},
        factors={name: table[name] for name in names},
    )
    if not len(rows.id):
        raise SettingsError(f"{study.folder}: holds no results yet")
    return rows


def read_overrides(study: StudyRecord, runs: Sequence[int]) -> dict[int, dict[str, Any]]:
    """Return the overrides by which each run differs from the base of the study, by dotted key."""
    import pyarrow as pa

    types = {"id": pa.int64(), "overrides": pa.string()}
    found: dict[int, dict[str, Any]] = {}
    for file in _files(study.folder):
        table = read_columns(file, types, [("id", "in", list(runs))])
        texts = zip(table["id"].to_pylist(), table["overrides"].to_pylist(), strict=True)
        found |= {run: overrides_of(text, f"{file}: run {run}") for run, text in texts}
    return found


def case_of(overrides: Mapping[str, Any]) -> Case:
    """Return overrides in the form that ``Scenarios`` takes."""
    return Case(0, 0, int(overrides["plant.seed"]), (), overrides)


def _types(study: StudyRecord) -> dict[str, Any]:
    import pyarrow as pa

    types = {"id": pa.int64(), "controller": pa.string(), "verdict": pa.string()}
    types |= {name: pa.int64() if name in COUNTS else pa.float64() for name in _FIGURES}
    for factor in study.factors:
        types[factor.name] = pa.float64() if are_numbers(factor.labels) else pa.string()
    return types


def _table(folder: Path, types: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Return columns as arrays, sorted by id; texts as objects that share their strings."""
    import pyarrow as pa

    table = pa.concat_tables([read_columns(file, types) for file in _files(folder)]).sort_by("id")
    arrays: dict[str, NDArray[Any]] = {}
    for name in types:
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


def _places(
    study: StudyRecord, table: Mapping[str, NDArray[Any]], column: str, known: Sequence[str]
) -> IntArray:
    place = {word: index for index, word in enumerate(known)}
    words = table[column].tolist()
    strange = sorted({*words} - place.keys())
    if strange:
        raise SettingsError(f"{study.folder}: no {column} of this study: {strange[0][:60]!r}")
    return np.array([place[word] for word in words], dtype=np.int64)


def _presentation(folder: Path) -> tuple[str, ReportSettings]:
    """Return what the report takes from the study file and no result depends on."""
    import tomllib

    try:
        content = tomllib.loads((folder / "study.toml").read_text(encoding="utf-8"))
        report = ReportSettings.model_validate(content.get("report", {}))
        return str(content.get("title", "")), report
    except (OSError, ValueError, RecursionError):
        return "", ReportSettings()
