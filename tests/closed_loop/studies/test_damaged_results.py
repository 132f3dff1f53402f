"""Damaged files of a study are reported in one line that names the file, by every reader.

The rows come from no real runs and only have the right form: nothing is computed here.
"""

import fcntl
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from steer_by_wire.closed_loop.studies.compiled_figures import COLUMNS
from steer_by_wire.closed_loop.studies.compiled_runs import Computed
from steer_by_wire.closed_loop.studies.result_files import Store
from steer_by_wire.closed_loop.studies.result_reader import read_overrides, read_rows, read_study
from steer_by_wire.closed_loop.studies.scenario import Scenarios
from steer_by_wire.runtime.settings import SettingsError
from tests.support.programs.failing_disk import failing_disk
from tests.support.programs.running_program import wait_until
from tests.support.runs.small_study import make_scenarios, open_store

RUNS = 48


@pytest.fixture(scope="module")
def scenarios(tmp_path_factory: pytest.TempPathFactory) -> Scenarios:
    return make_scenarios(tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="module")
def whole(scenarios: Scenarios, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a chunk that is complete, one that is begun, and all rows in one file."""
    folder = tmp_path_factory.mktemp("whole")
    store = open_store(folder, scenarios)
    put(store, range(30))
    store.flush()
    chunks = folder / "kept"
    shutil.copytree(folder / "out" / "chunks", chunks)
    put(store, range(30, RUNS))
    store.finish()
    return folder


def put(store: Store, runs: range) -> None:
    ids = np.array(runs, dtype=np.int64)
    store.put(Computed(ids, np.zeros_like(ids), np.zeros((len(ids), len(COLUMNS)))))


@pytest.fixture
def folder(whole: Path, tmp_path: Path) -> Path:
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    return tmp_path


def refusal(read: Callable[[], object]) -> str:
    with pytest.raises(SettingsError) as raised:
        read()
    assert len(raised.value.mistakes) == 1
    return str(raised.value)


def all_read(folder: Path) -> None:
    study = read_study(folder)
    read_rows(study)
    read_overrides(study, range(RUNS))


def test_what_is_whole_is_read(folder: Path, scenarios: Scenarios) -> None:
    study = read_study(folder / "out")
    assert read_rows(study).id.tolist() == [*range(RUNS)]
    assert read_overrides(study, [3, 47]).keys() == {3, 47}
    store = open_store(folder, scenarios)
    assert store.stored() == RUNS
    found = store.find(47)
    assert found is not None
    assert found["id"] == 47


BROKEN_JSON = (b"", b"\xff\xfe", b"{", b"[" * 100_000)


@pytest.mark.parametrize("content", BROKEN_JSON)
def test_a_record_that_is_no_json_is_reported_by_report_and_study(
    content: bytes, folder: Path, scenarios: Scenarios
) -> None:
    (folder / "out" / "study.json").write_bytes(content)
    for read in (lambda: all_read(folder / "out"), lambda: open_store(folder, scenarios)):
        assert refusal(read).startswith(f"{folder / 'out' / 'study.json'}: is not JSON")


PARTS = ("name", "levels", "sampling", "verdict", "plant", "controllers")
OTHERS: tuple[Any, ...] = (None, 7, "x", [1], {"a": 1})


@pytest.mark.parametrize(
    ("key", "value"),
    [(key, other) for key in PARTS for other in OTHERS if (key, other) != ("name", "x")],
)
def test_a_record_with_a_part_that_is_none_of_its_kind_is_reported(
    key: str, value: Any, folder: Path
) -> None:
    file = folder / "out" / "study.json"
    record = json.loads(file.read_text())
    file.write_text(json.dumps(record | {key: value}))
    assert str(folder / "out") in refusal(lambda: all_read(folder / "out"))


def changed(file: Path, change: Callable[[Any], Any]) -> None:
    parquet.write_table(change(parquet.read_table(file)), file)


def with_column(name: str, values: Any) -> Callable[[Any], Any]:
    def change(table: Any) -> Any:
        made = pa.array([values] * table.num_rows)
        return table.set_column(table.column_names.index(name), name, made)

    return change


def without_values(name: str) -> Callable[[Any], Any]:
    def change(table: Any) -> Any:
        place = table.column_names.index(name)
        gaps = pa.nulls(table.num_rows, table.schema.field(name).type)
        return table.set_column(place, name, gaps)

    return change


DAMAGES: dict[str, tuple[Callable[[Any], Any], str]] = {
    "a column is missing": (lambda table: table.drop(["verdict"]), "has no column verdict"),
    "texts for numbers": (with_column("rms_m", "x"), "column rms_m is string, not double"),
    "gaps": (without_values("overrides"), "column overrides has gaps"),
    "ids beyond the study": (with_column("id", 48), "runs that this study does not have"),
    "ids twice": (with_column("id", 1), "runs that this study does not have"),
    "another controller": (with_column("controller", "x"), "no controller of this study: 'x'"),
    "another verdict": (with_column("verdict", "x"), "no verdict of this study: 'x'"),
    "overrides that are no JSON": (with_column("overrides", "{"), "overrides are not JSON"),
    "overrides that are no table": (with_column("overrides", "[1]"), "no table with a plant.seed"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_rows_that_are_not_of_the_study_are_reported_by_the_report(
    damage: str, folder: Path
) -> None:
    change, expected = DAMAGES[damage]
    changed(folder / "out" / "results.parquet", change)
    assert expected in refusal(lambda: all_read(folder / "out"))


def no_parquet(file: Path) -> None:
    file.write_bytes(b"PAR1")


def other_columns(file: Path) -> None:
    changed(file, lambda table: table.select(["id"]))


def folder_in_its_place(file: Path) -> None:
    file.unlink()
    file.mkdir()


@pytest.mark.parametrize("damage", [no_parquet, other_columns, folder_in_its_place])
@pytest.mark.parametrize(
    "name", ["results.parquet", "chunks/000000.parquet", "chunks/000001.part.parquet"]
)
def test_a_study_does_not_go_on_with_files_that_are_damaged(
    name: str, damage: Callable[[Path], None], folder: Path, scenarios: Scenarios
) -> None:
    if name.startswith("chunks"):
        (folder / "out" / "results.parquet").unlink()
        shutil.copytree(folder / "kept", folder / "out" / "chunks")
    damage(folder / "out" / name)
    assert str(folder / "out" / name) in refusal(lambda: open_store(folder, scenarios).stored())


@pytest.mark.parametrize(
    "change", [with_column("id", 7), with_column("id", 10**6), with_column("ended_by", "x")]
)
def test_a_chunk_with_rows_of_others_is_not_gone_on_with(
    change: Callable[[Any], Any], folder: Path, scenarios: Scenarios
) -> None:
    (folder / "out" / "results.parquet").unlink()
    shutil.copytree(folder / "kept", folder / "out" / "chunks")
    changed(folder / "out" / "chunks" / "000001.part.parquet", change)
    expected = refusal(lambda: [*open_store(folder, scenarios).missing()])
    assert "holds other rows than of runs 20 to 39" in expected


def test_a_complete_study_with_too_few_rows_is_reported(folder: Path, scenarios: Scenarios) -> None:
    changed(folder / "out" / "results.parquet", lambda table: table.slice(0, 40))
    assert "has 40 rows, not 48" in refusal(lambda: open_store(folder, scenarios))


def test_no_flipped_bit_makes_another_figure(scenarios: Scenarios, tmp_path: Path) -> None:
    """Seeded; without checksums four of five flips did."""
    random = np.random.default_rng(1)
    store = open_store(tmp_path, scenarios)
    ids = np.arange(RUNS)
    store.put(Computed(ids, np.zeros_like(ids), random.random((RUNS, len(COLUMNS)))))
    store.finish()
    study = read_study(store.folder)
    expected = repr(read_rows(study))
    written = store.results.read_bytes()
    refused = 0
    for bit in random.integers(0, 8 * len(written), 150).tolist():
        damaged = bytearray(written)
        damaged[bit // 8] ^= 1 << bit % 8
        store.results.write_bytes(damaged)
        try:
            rows = read_rows(study)
        except SettingsError:
            refused += 1
            continue
        assert repr(rows) == expected, bit
    assert refused > 40  # of the columns that are read


def test_another_process_does_not_write_into_the_same_folder(
    scenarios: Scenarios, tmp_path: Path
) -> None:
    folder = open_store(tmp_path, scenarios).folder
    other = "import fcntl, sys; f = open(sys.argv[1], 'wb'); fcntl.lockf(f, fcntl.LOCK_EX); input()"
    command = [sys.executable, "-c", other, str(folder / ".lock")]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as process:
        wait_until(lambda: is_locked(folder), "the other process has locked the folder")
        assert "another process computes a study there" in refusal(
            lambda: open_store(tmp_path, scenarios)
        )
        process.kill()
    open_store(tmp_path, scenarios)


def is_locked(folder: Path) -> bool:
    with (folder / ".lock").open("wb") as lock:
        try:
            fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return True
    return False


def test_another_version_does_not_go_on(
    scenarios: Scenarios, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    open_store(tmp_path, scenarios)
    monkeypatch.setattr("steer_by_wire.closed_loop.studies.study.version", lambda _name: "0.0")
    assert "another study: version differ" in refusal(lambda: open_store(tmp_path, scenarios))


def test_a_folder_that_was_begun_and_cut_short_anywhere_can_be_continued(
    scenarios: Scenarios, tmp_path: Path
) -> None:
    """Without its study.json it was refused, as if it held results of nobody knows what."""
    for use in range(1, 50):
        with failing_disk(tmp_path, use) as disk, suppress(OSError):
            open_store(tmp_path / f"{use}", scenarios)
        assert open_store(tmp_path / f"{use}", scenarios).stored() == 0
        if not disk.has_failed:
            break
    assert 5 < use < 49
