"""Where the results of a study go: Parquet files that survive an interruption.

    FOLDER/study.json                 what determines the results; a study is continued only if it
                                      is the same
    FOLDER/chunks/000012.parquet      the rows of ``CHUNK_RUNS`` ids that follow each other, sorted
    FOLDER/chunks/000013.part.parquet those of a chunk that is not complete yet
    FOLDER/results.parquet            all rows, sorted by id, when the study is complete; the chunks
                                      are then removed

Every file is written under another name, brought to the disk and then renamed, so that it is either
whole or absent. Rows hold no time of day and no name of a machine: the same study gives the same
bytes. Each page of a file has a checksum: a damaged file raises a SettingsError of one line.
One process at a time writes into a folder.
"""

import importlib
import importlib.util
import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ...plant_emulator.evaluation.run_verdict import RUN_ENDS
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.command_line import installation
from ...runtime.output_file import write_text, write_whole
from ...runtime.program.output_folder import refuse_another_run
from ...runtime.settings import SettingsError
from .compiled_figures import COLUMNS, COUNTS, verdicts
from .compiled_runs import Computed
from .scenario import Scenarios

CHUNK_RUNS = 4096
"""Rows of a chunk: about a megabyte in memory."""
WRITE_S = 10.0
"""Interval at which incomplete chunks are written: the most computing that a crash can lose."""
RESULTS = "results.parquet"
_WRITTEN: Mapping[str, Any] = {"compression": "zstd", "write_page_checksum": True}


class Store:
    """The folder of one study; rows go in as they are computed, in any order."""

    def __init__(self, folder: Path, scenarios: Scenarios, chunk_runs: int = CHUNK_RUNS) -> None:
        self._arrow, self._parquet = _pyarrow()
        self.folder = folder
        self._chunks = folder / "chunks"
        self.scenarios = scenarios
        self._runs = scenarios.study.runs
        self._chunk_runs = chunk_runs
        self._open: dict[int, _Chunk] = {}
        self._written_s = time.monotonic()
        self._schema = self._make_schema()
        self._types = dict(zip(self._schema.names, self._schema.types, strict=True))

    @property
    def results(self) -> Path:
        """Where all rows are when the study is complete."""
        return self.folder / RESULTS

    @property
    def is_complete(self) -> bool:
        """Whether all rows are there, sorted."""
        return self.results.exists()

    def open(self, text: str) -> None:
        """Create the folder or continue in it; raises SettingsError if it holds another study, or
        if its files are damaged.

        ``text``  of the study file, kept beside the results
        """
        refuse_another_run(self.folder, {})
        identity = self.scenarios.study.identity
        file = self.folder / "study.json"
        if file.exists():
            _refuse_another(self.folder, read_json(file), identity)
        elif self.results.exists() or self._chunks.exists():
            raise SettingsError(
                f"{self.folder}: holds results, but no study.json that describes the study; "
                "give --out another folder"
            )
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock = _FolderLock(self.folder)
        # Before there is anything of it: what is killed in between can be continued.
        write_text(file, identity)
        write_text(self.folder / "study.toml", text)
        if self.is_complete:
            rows = check_columns(self.results, self._types)
            if rows != self._runs:
                raise SettingsError(f"{self.results}: has {rows} rows, not {self._runs}; remove it")
            shutil.rmtree(self._chunks, ignore_errors=True)
        else:
            self._chunks.mkdir(exist_ok=True)

    def stored(self) -> int:
        """Return how many runs are stored."""
        if self.is_complete:
            return self._runs
        files = set(self._chunks.glob("*.parquet")) if self._chunks.exists() else set()
        # An interruption may leave a part beside its complete chunk.
        files -= {self._part(int(file.stem)) for file in files if file.stem.isdigit()}
        return sum(check_columns(file, self._types) for file in files)

    def missing(self) -> Iterator[list[int]]:
        """Yield the ids that are not stored yet, chunk by chunk, in order."""
        for number in range(-(-self._runs // self._chunk_runs)):
            if self._file(number).exists():
                continue
            chunk = self._chunk(number)
            ids = np.flatnonzero(~chunk.is_done) + number * self._chunk_runs
            yield ids.tolist()

    def put(self, computed: Computed) -> None:
        """Take runs; complete chunks are written, and every WRITE_S the others too."""
        numbers = computed.ids // self._chunk_runs
        for number in np.unique(numbers).tolist():
            rows = numbers == number
            chunk = self._chunk(number)
            chunk.take(Computed(*(column[rows] for column in computed)), number * self._chunk_runs)
            if chunk.is_done.all():
                self._write_chunk(self._file(number), number, chunk)
                self._part(number).unlink(missing_ok=True)
                del self._open[number]
        if time.monotonic() - self._written_s >= WRITE_S:
            self.flush()

    def flush(self) -> None:
        """Write the rows of the incomplete chunks."""
        for number, chunk in self._open.items():
            if chunk.is_new:
                self._write_chunk(self._part(number), number, chunk)
                chunk.is_new = False
        self._written_s = time.monotonic()

    def finish(self) -> None:
        """Join all chunks; every run must be stored."""
        if self.is_complete:
            return

        def write(place: Path) -> None:
            with self._parquet.ParquetWriter(place, self._schema, **_WRITTEN) as writer:
                for number in range(-(-self._runs // self._chunk_runs)):
                    table = read_columns(self._file(number), self._types)
                    self._places(self._file(number), number, table)
                    writer.write_table(table)

        write_whole(self.results, write)
        shutil.rmtree(self._chunks)

    def find(self, run: int) -> dict[str, Any] | None:
        """Return one row by its id; None if it is not stored."""
        number = run // self._chunk_runs
        for file in (self.results, self._file(number), self._part(number)):
            if file.exists():
                table = read_columns(file, self._types, [("id", "=", run)])
                if table.num_rows:
                    found: dict[str, Any] = table.to_pylist()[0]
                    return found
        return None

    def _file(self, number: int) -> Path:
        return self._chunks / f"{number:06d}.parquet"

    def _part(self, number: int) -> Path:
        return self._chunks / f"{number:06d}.part.parquet"

    def _chunk(self, number: int) -> "_Chunk":
        if number not in self._open:
            size = min(self._chunk_runs, self._runs - number * self._chunk_runs)
            chunk = _Chunk(size)
            if self._part(number).exists():
                chunk.take(self._read(self._part(number), number), number * self._chunk_runs)
                chunk.is_new = False
            self._open[number] = chunk
        return self._open[number]

    def _read(self, file: Path, number: int) -> Computed:
        table = read_columns(file, self._types)
        ids = self._places(file, number, table)
        ends = [RUN_ENDS.index(end) for end in table["ended_by"].to_pylist()]
        figures = [table[name].to_numpy().astype(np.float64) for name in COLUMNS]
        return Computed(ids, np.array(ends, dtype=np.int64), np.column_stack(figures))

    def _places(self, file: Path, number: int, table: Any) -> IntArray:
        """Return the ids of the rows of a chunk; raises SettingsError for rows of another one."""
        ids: IntArray = table["id"].to_numpy()
        first = number * self._chunk_runs
        last = min(first + self._chunk_runs, self._runs) - 1
        is_own = len(ids) == len(np.unique(ids)) and np.all((first <= ids) & (ids <= last))
        if not is_own or not set(table["ended_by"].to_pylist()) <= {*map(str, RUN_ENDS)}:
            raise SettingsError(
                f"{file}: holds other rows than of runs {first} to {last}; remove it"
            )
        return ids

    def _write_chunk(self, file: Path, number: int, chunk: "_Chunk") -> None:
        done = np.flatnonzero(chunk.is_done)
        table = self._table(done + number * self._chunk_runs, chunk.ends[done], chunk.figures[done])
        write_whole(file, lambda place: self._parquet.write_table(table, place, **_WRITTEN))

    def _table(self, ids: IntArray, ends: IntArray, figures: FloatArray) -> Any:
        study = self.scenarios.study
        names = list(study.controllers)
        cases = ids // len(names)
        unique, first = np.unique(cases, return_inverse=True)
        made = [self.scenarios.case(index) for index in unique.tolist()]
        rows = [made[place] for place in first.tolist()]
        texts = [json.dumps(case.overrides) for case in made]
        controllers = [names[place] for place in (ids % len(names)).tolist()]
        laws = {name: str(tables["law"]) for name, tables in study.controllers.items()}
        columns: dict[str, Any] = {
            "id": ids,
            "point": [case.point for case in rows],
            "replicate": [case.replicate for case in rows],
            "seed": [case.seed for case in rows],
            "controller": controllers,
            "law": [laws[name] for name in controllers],
        }
        for place, factor in enumerate(study.design.factors):
            kind = self._schema.field(factor.name).type
            labels = [case.labels[place] for case in rows]
            text = kind == self._arrow.string()
            columns[factor.name] = [str(label) for label in labels] if text else labels
        columns["verdict"] = [str(v) for v in verdicts(study.settings.verdict, ends, figures)]
        columns["ended_by"] = [str(RUN_ENDS[end]) for end in ends.tolist()]
        for place, name in enumerate(COLUMNS):
            values = figures[:, place]
            columns[name] = values.astype(np.int64) if name in COUNTS else values
        columns["overrides"] = [
            json.dumps(self.scenarios.with_controller(case, name).overrides)
            if name in self.scenarios.plant_of
            else texts[place]
            for case, name, place in zip(rows, controllers, first.tolist(), strict=True)
        ]
        return self._arrow.table(columns, schema=self._schema)

    def _make_schema(self) -> Any:
        arrow = self._arrow
        whole, real, text = arrow.int64(), arrow.float64(), arrow.string()
        fields = [(name, whole) for name in ("id", "point", "replicate", "seed")]
        fields += [("controller", text), ("law", text)]
        for factor in self.scenarios.study.design.factors:
            labels = [level.label for level in factor.levels or ()]
            fields.append((factor.name, real if are_numbers(labels) else text))
        fields += [("verdict", text), ("ended_by", text)]
        fields += [(name, whole if name in COUNTS else real) for name in COLUMNS]
        return arrow.schema([*fields, ("overrides", text)])


class _Chunk:
    def __init__(self, size: int) -> None:
        self.is_done = np.zeros(size, dtype=np.bool_)
        self.ends = np.zeros(size, dtype=np.int64)
        self.figures = np.full((size, len(COLUMNS)), np.nan)
        self.is_new = False

    def take(self, computed: Computed, first: int) -> None:
        """Take rows whose ids count from ``first``."""
        places = computed.ids - first
        self.is_done[places] = True
        self.ends[places] = computed.ends
        self.figures[places] = computed.figures
        self.is_new = True


def are_numbers(labels: Sequence[Any]) -> bool:
    """Whether a factor with these labels has a column of numbers."""
    return all(isinstance(label, int | float) and not isinstance(label, bool) for label in labels)


class _FolderLock:
    """Keeps other processes out of a folder as long as it lives; raises SettingsError.

    The lock is this process's own: workers that outlive it for a moment do not keep it.
    """

    def __init__(self, folder: Path) -> None:
        self._descriptor = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT)
        if not importlib.util.find_spec("fcntl"):  # only Unix has it
            return
        import fcntl

        try:
            fcntl.lockf(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise SettingsError(
                f"{folder}: another process computes a study there; wait for it, or give --out"
                " another folder"
            ) from error

    def __del__(self) -> None:
        os.close(self._descriptor)


def _refuse_another(folder: Path, old: Any, wanted: str) -> None:
    new = json.loads(wanted)
    different = [key for key in new if not isinstance(old, dict) or old.get(key) != new[key]]
    if different:
        raise SettingsError(
            f"{folder}: holds the results of another study: {', '.join(different)} differ; "
            "give --out another folder, or delete this one"
        )


def _pyarrow() -> tuple[ModuleType, ModuleType]:
    """Return pyarrow and pyarrow.parquet; raises SettingsError where they are missing."""
    try:
        arrow = importlib.import_module("pyarrow")
        parquet = importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise SettingsError(
            f"results are stored as Parquet, which needs pyarrow: {installation('pyarrow')}"
        ) from error
    return arrow, parquet


_WHAT_TO_DO = "remove it, and the study computes its content again"
_CAUSE_LENGTH_MAX = 160


def read_json(file: Path) -> Any:
    """Return the content of a JSON file; raises OSError, and SettingsError for invalid JSON."""
    try:
        return json.loads(file.read_bytes())
    except (ValueError, RecursionError) as error:  # ValueError covers UnicodeDecodeError
        raise SettingsError(f"{file}: is not JSON: {cause_line(error)}") from error


def check_columns(file: Path, types: Mapping[str, Any]) -> int:
    """Return the number of rows of a Parquet file that has these columns; raises SettingsError."""
    from pyarrow import ArrowException, parquet

    try:
        metadata = parquet.read_metadata(file)
        schema = metadata.schema.to_arrow_schema()
    except (ArrowException, OSError) as error:
        raise _damaged(file, cause_line(error)) from error
    for name, kind in types.items():
        place = schema.get_field_index(name)  # -1 for a duplicate name, too
        if place < 0:
            raise _damaged(file, f"has no column {name}")
        if schema.field(place).type != kind:
            raise _damaged(file, f"column {name} is {schema.field(place).type}, not {kind}")
    return int(metadata.num_rows)


def read_columns(
    file: Path, types: Mapping[str, Any], filters: Sequence[tuple[str, str, Any]] | None = None
) -> Any:
    """Return these columns as a table without gaps; raises SettingsError.

    ``types``    pyarrow's, by column
    ``filters``  which rows, in pyarrow's form; without any, all rows
    """
    from pyarrow import ArrowException, parquet

    rows = check_columns(file, types)
    try:
        table = parquet.read_table(
            file,
            columns=[*types],
            filters=None if filters is None else [*filters],
            page_checksum_verification=True,
        )
    except (ArrowException, OSError) as error:
        raise _damaged(file, cause_line(error)) from error
    if filters is None and table.num_rows != rows:
        raise _damaged(file, f"has {table.num_rows} rows, not {rows}")
    for name in types:
        if table[name].null_count:
            raise _damaged(file, f"column {name} has gaps")
    return table


def overrides_of(text: str, where: str) -> dict[str, Any]:
    """Return the overrides of a run, by dotted key; raises SettingsError.

    ``where``  names the place for the error message
    """
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"{where}: overrides are not JSON: {cause_line(error)}") from error
    if not isinstance(found, dict) or not isinstance(found.get("plant.seed"), int):
        raise SettingsError(f"{where}: overrides are no table with a plant.seed")
    return found


def _damaged(file: Path, what: str) -> SettingsError:
    return SettingsError(f"{file}: results cannot be read: {what}; {_WHAT_TO_DO}")


def cause_line(error: Exception) -> str:
    """Return what an error says, in one line of some length."""
    return " ".join(str(error).split())[:_CAUSE_LENGTH_MAX]
