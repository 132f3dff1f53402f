"""Results of a study: Parquet files that survive an interruption.

    FOLDER/study.json                 what determines the results; a study is continued only if it
                                      is the same
    FOLDER/chunks/000012.parquet      the rows so far of ``CHUNK_RUNS`` ids that follow each other
    FOLDER/results.parquet            all rows, sorted by id, when the study is complete; the chunks
                                      are then removed

Every file is written under another name, brought to the disk and then renamed, so that it is either
whole or absent. Rows hold no time of day and no name of a machine: the same study gives the same
bytes. A digest in each file binds it to study.json (``row_file``). One process at a time writes
into a folder.
"""

import importlib.util
import json
import os
import shutil
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...plant_emulator.evaluation.run_verdict import RUN_ENDS
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.input_file import read_bytes
from ...runtime.output_file import write_text
from ...runtime.program.output_folder import refuse_another_run
from ...runtime.settings import SettingsError
from .compiled_figures import COLUMNS, COUNTS, verdicts
from .compiled_runs import Computed
from .row_file import check, count_rows, pyarrow, read_table, write_rows
from .scenario import Scenarios

CHUNK_RUNS = 4096
"""Rows of a chunk: about a megabyte in memory."""
WRITE_S = 10.0
"""Interval at which incomplete chunks are written: the most computing that a crash can lose."""
RESULTS = "results.parquet"
STUDY = "study.json"


class Store:
    """The folder of one study; rows go in as they are computed, in any order."""

    def __init__(self, folder: Path, scenarios: Scenarios, chunk_runs: int = CHUNK_RUNS) -> None:
        self._arrow, _ = pyarrow()
        self.folder = folder
        self._chunks = folder / "chunks"
        self.scenarios = scenarios
        self._runs = scenarios.study.runs
        self._chunk_runs = chunk_runs
        self._open: dict[int, _Chunk] = {}
        self._written_s = time.monotonic()
        self._schema = self._make_schema()
        self._record = scenarios.study.identity.encode()

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

        ``text``  of the study file, kept with the results
        """
        refuse_another_run(self.folder, {})
        identity = self.scenarios.study.identity
        file = self.folder / STUDY
        if file.exists():
            _refuse_another(self.folder, read_bytes(file), identity)
        elif self.results.exists() or self._chunks.exists():
            raise SettingsError(
                f"{self.folder}: holds results, but no {STUDY} that describes the study; "
                "give --out another folder"
            )
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock = _FolderLock(self.folder)
        # Before there is anything of it: what is killed in between can be continued.
        write_text(file, identity)
        write_text(self.folder / "study.toml", text)
        if self.is_complete:
            check(self.results, self._record)
            shutil.rmtree(self._chunks, ignore_errors=True)
        else:
            self._chunks.mkdir(exist_ok=True)

    def stored(self) -> int:
        """Return how many runs are stored."""
        if self.is_complete:
            return self._runs
        return sum(count_rows(file, self._record) for file in self._chunks.glob("*.parquet"))

    def missing(self) -> Iterator[list[int]]:
        """Yield the ids that are not stored yet, chunk by chunk, in order."""
        for number in range(-(-self._runs // self._chunk_runs)):
            is_missing = ~self._chunk(number).is_done
            if is_missing.any():
                yield (np.flatnonzero(is_missing) + number * self._chunk_runs).tolist()
            else:
                del self._open[number]

    def put(self, computed: Computed) -> None:
        """Take runs; complete chunks are written, and every WRITE_S the others too."""
        numbers = computed.ids // self._chunk_runs
        for number in np.unique(numbers).tolist():
            rows = numbers == number
            chunk = self._chunk(number)
            chunk.store(Computed(*(column[rows] for column in computed)), number * self._chunk_runs)
            if chunk.is_done.all():
                self._write_chunk(number, chunk)
                del self._open[number]
        if time.monotonic() - self._written_s >= WRITE_S:
            self.flush()

    def flush(self) -> None:
        """Write the rows of the incomplete chunks."""
        for number, chunk in self._open.items():
            if chunk.is_new:
                self._write_chunk(number, chunk)
                chunk.is_new = False
        self._written_s = time.monotonic()

    def finish(self) -> None:
        """Join all chunks; every run must be stored."""
        if self.is_complete:
            return
        chunks = map(self._file, range(-(-self._runs // self._chunk_runs)))
        tables = (read_table(file, self._record) for file in chunks)
        write_rows(self.results, self._record, self._schema, tables)
        shutil.rmtree(self._chunks)

    def find(self, run: int) -> dict[str, Any] | None:
        """Return one row by its id; None if it is not stored."""
        number = run // self._chunk_runs
        for file in (self.results, self._file(number)):
            if file.exists():
                table = read_table(file, self._record, filters=[("id", "=", run)])
                if table.num_rows:
                    found: dict[str, Any] = table.to_pylist()[0]
                    return found
        return None

    def _file(self, number: int) -> Path:
        return self._chunks / f"{number:06d}.parquet"

    def _chunk(self, number: int) -> "_Chunk":
        if number not in self._open:
            size = min(self._chunk_runs, self._runs - number * self._chunk_runs)
            chunk = _Chunk(size)
            if self._file(number).exists():
                chunk.store(self._read(self._file(number)), number * self._chunk_runs)
                chunk.is_new = False
            self._open[number] = chunk
        return self._open[number]

    def _read(self, file: Path) -> Computed:
        table = read_table(file, self._record)
        ends = [RUN_ENDS.index(end) for end in table["ended_by"].to_pylist()]
        figures = [table[name].to_numpy().astype(np.float64) for name in COLUMNS]
        return Computed(
            table["id"].to_numpy(), np.array(ends, dtype=np.int64), np.column_stack(figures)
        )

    def _write_chunk(self, number: int, chunk: "_Chunk") -> None:
        done = np.flatnonzero(chunk.is_done)
        table = self._table(done + number * self._chunk_runs, chunk.ends[done], chunk.figures[done])
        write_rows(self._file(number), self._record, self._schema, [table])

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

    def store(self, computed: Computed, first: int) -> None:
        """Store rows whose ids count from ``first``."""
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


def _refuse_another(folder: Path, old: bytes, wanted: str) -> None:
    try:
        known = json.loads(old)
    except (ValueError, RecursionError):  # ValueError covers UnicodeDecodeError
        known = None
    new = json.loads(wanted)
    different = [key for key in new if not isinstance(known, dict) or known.get(key) != new[key]]
    if different:
        raise SettingsError(
            f"{folder}: holds the results of another study: {', '.join(different)} differ; "
            "give --out another folder, or delete this one"
        )
