"""Results of a study: Parquet files that survive an interruption.

    FOLDER/study.json                 what determines the results; a study is continued only if it
                                      is the same
    FOLDER/chunks/00004096.parquet    rows so far, named by the first id; each row is in one file
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
from ...runtime.input_file import read_bytes
from ...runtime.output_file import write_text
from ...runtime.settings import SettingsError
from .compiled_figures import COUNTS, HAND_WHEEL_VERDICT, verdicts
from .compiled_runs import Computed
from .row_file import check, pyarrow, read_table, write_rows
from .scenario import Scenarios

CHUNK_RUNS = 4096
"""Rows that are handed out, kept in memory and written together: about a megabyte."""
WRITE_S = 10.0
"""Rows wait this long to be written: the most computing that a crash can lose."""
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
        self._done = np.zeros(self._runs, dtype=np.bool_)
        self._new: list[Computed] = []
        self._written_s = time.monotonic()
        self._record = scenarios.study.record.encode()

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
        record = self.scenarios.study.record
        file = self.folder / STUDY
        if file.exists():
            _refuse_another(self.folder, read_bytes(file), record)
        elif self.results.exists() or self._chunks.exists():
            raise SettingsError(
                f"{self.folder}: holds results, but no {STUDY} that describes the study; "
                "give --out another folder"
            )
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock = _FolderLock(self.folder)
        # Before there is anything of it: what is killed in between can be continued.
        write_text(file, record)
        write_text(self.folder / "study.toml", text)
        if self.is_complete:
            check(self.results, self._record)
            shutil.rmtree(self._chunks, ignore_errors=True)
            self._done[:] = True
            return
        self._chunks.mkdir(exist_ok=True)
        for file in self._files():
            self._done[read_table(file, self._record, ["id"])["id"].to_numpy()] = True

    def stored(self) -> int:
        """Return how many runs are stored."""
        return int(np.count_nonzero(self._done))

    def missing(self) -> Iterator[list[int]]:
        """Yield the ids that are not stored, in order, at most ``chunk_runs`` at once."""
        for first in range(0, self._runs, self._chunk_runs):
            ids = first + np.flatnonzero(~self._done[first : first + self._chunk_runs])
            if len(ids):
                yield ids.tolist()

    def put(self, computed: Computed) -> None:
        """Take runs that are not stored yet; they are written in batches."""
        self._done[computed.ids] = True
        self._new.append(computed)
        is_late = time.monotonic() - self._written_s >= WRITE_S
        if is_late or sum(len(block.ids) for block in self._new) >= self._chunk_runs:
            self.flush()

    def flush(self) -> None:
        """Write the rows that wait."""
        if self._new:
            computed = Computed(*map(np.concatenate, zip(*self._new, strict=True)))
            file = self._chunks / f"{computed.ids.min():08d}.parquet"
            write_rows(file, self._record, [self._table(computed)])
            self._new.clear()
        self._written_s = time.monotonic()

    def finish(self) -> None:
        """Join all chunks; every run must be stored."""
        if self.is_complete:
            return
        self.flush()
        tables = [read_table(file, self._record) for file in self._files()]
        table = self._arrow.concat_tables(tables).sort_by("id")
        firsts = range(0, self._runs, self._chunk_runs)
        parts = [table.slice(first, self._chunk_runs) for first in firsts]
        write_rows(self.results, self._record, parts)
        shutil.rmtree(self._chunks)

    def _files(self) -> list[Path]:
        return sorted(self._chunks.glob("*.parquet"))

    def _table(self, computed: Computed) -> Any:
        columns = columns_of(self.scenarios, computed)
        for factor in self.scenarios.study.factors:
            of_label = float if are_numbers(factor.labels) else str
            columns[factor.name] = list(map(of_label, columns[factor.name]))
        return self._arrow.table(columns)


def columns_of(scenarios: Scenarios, computed: Computed) -> dict[str, Any]:
    """Return the columns of computed runs by name; factors by their labels."""
    study, names = scenarios.study, scenarios.study.names
    cases, places = np.divmod(computed.ids, len(names))
    made = {index: scenarios.case(index) for index in dict.fromkeys(cases.tolist())}
    rows = [made[index] for index in cases.tolist()]
    controllers = [names[place] for place in places.tolist()]
    laws = {name: str(tables["law"]) for name, tables in study.controllers.items()}
    judged = verdicts(study.settings.verdict, computed.ends, computed.figures)
    figures = dict(zip(study.columns, computed.figures.T.copy(), strict=True))
    of_wheel = {}
    if study.hand_wheels:
        found = np.where(np.isnan(figures["hand_wheel_shakes_hz"]), "still", "shakes")
        of_wheel = {HAND_WHEEL_VERDICT: np.where(figures["samples"] > 0, found, "").tolist()}
    return {
        "id": computed.ids,
        "point": [case.point for case in rows],
        "replicate": [case.replicate for case in rows],
        "seed": [case.seed for case in rows],
        "controller": controllers,
        "law": [laws[name] for name in controllers],
        **{
            factor.name: [case.labels[place] for case in rows]
            for place, factor in enumerate(study.design.factors)
        },
        "verdict": [str(verdict) for verdict in judged],
        "ended_by": [str(RUN_ENDS[end]) for end in computed.ends.tolist()],
        **of_wheel,
        **figures,
        **{name: figures[name].astype(np.int64) for name in COUNTS},
        "overrides": [
            json.dumps(scenarios.with_controller(case, name).overrides)
            for case, name in zip(rows, controllers, strict=True)
        ],
    }


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
