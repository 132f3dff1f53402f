"""Damaged files of a study: every reader reports them in one line that names the file.

The rows come from no real runs and only have the right form: nothing is computed here.
"""

import fcntl
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop.studies.compiled_figures import COLUMNS
from steer_by_wire.closed_loop.studies.compiled_runs import Computed
from steer_by_wire.closed_loop.studies.result_files import Store
from steer_by_wire.closed_loop.studies.result_reader import read_results
from steer_by_wire.closed_loop.studies.scenario import Scenarios
from steer_by_wire.runtime.settings import SettingsError
from tests.support.programs.failing_disk import failing_disk
from tests.support.programs.running_program import wait_until
from tests.support.runs.small_study import STUDY, make_scenarios, open_store, stored_row

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


def test_what_is_whole_is_read(folder: Path, scenarios: Scenarios) -> None:
    _, rows = read_results(folder / "out")
    assert rows["id"].tolist() == [*range(RUNS)]
    store = open_store(folder, scenarios)
    assert store.stored() == RUNS
    assert stored_row(store, 47) is not None


def test_every_reader_refuses_a_record_that_is_not_as_it_was_written(
    folder: Path, scenarios: Scenarios
) -> None:
    record = folder / "out" / "study.json"
    for content in (b"", b"{", record.read_bytes().replace(b'"small"', b'"smell"')):
        record.write_bytes(content)
        assert str(folder / "out") in refusal(lambda: read_results(folder / "out"))
        assert "of another study" in refusal(lambda: open_store(folder, scenarios))


def rows_of_another_study(file: Path) -> None:
    other = "[sampling]\nreplicates = 2\nseed = 12\n"
    text = STUDY.partition("[sampling]")[0] + other
    store = open_store(file.parent / "other", make_scenarios(file.parent / "other", text))
    put(store, range(RUNS))
    store.finish()
    file.unlink()
    shutil.move(store.results, file)
    shutil.rmtree(file.parent / "other")


def no_parquet(file: Path) -> None:
    file.write_bytes(b"PAR1")


def empty(file: Path) -> None:
    file.write_bytes(b"")


def folder_in_its_place(file: Path) -> None:
    file.unlink()
    file.mkdir()


@pytest.mark.parametrize("damage", [rows_of_another_study, no_parquet, empty, folder_in_its_place])
@pytest.mark.parametrize("name", ["results.parquet", "chunks/00000000.parquet"])
def test_every_reader_refuses_files_that_are_damaged_or_anothers(
    name: str, damage: Callable[[Path], None], folder: Path, scenarios: Scenarios
) -> None:
    if name.startswith("chunks"):
        (folder / "out" / "results.parquet").unlink()
        shutil.copytree(folder / "kept", folder / "out" / "chunks")
    damage(folder / "out" / name)
    assert str(folder / "out" / name) in refusal(lambda: open_store(folder, scenarios).stored())
    assert str(folder / "out" / name) in refusal(lambda: read_results(folder / "out"))


def test_every_flipped_bit_is_noticed_when_the_folder_is_opened(
    folder: Path, scenarios: Scenarios
) -> None:
    results = folder / "out" / "results.parquet"
    written = results.read_bytes()
    for bit in np.random.default_rng(1).integers(0, 8 * len(written), 150).tolist():
        damaged = bytearray(written)
        damaged[bit // 8] ^= 1 << bit % 8
        results.write_bytes(damaged)
        refusal(lambda: open_store(folder, scenarios))
        refusal(lambda: read_results(folder / "out"))


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
    """Without its study.json it was refused, as if it held results of an unknown study."""
    for use in range(1, 50):
        with failing_disk(tmp_path, use) as disk, suppress(OSError):
            open_store(tmp_path / f"{use}", scenarios)
        assert open_store(tmp_path / f"{use}", scenarios).stored() == 0
        if not disk.has_failed:
            break
    assert 5 < use < 49
