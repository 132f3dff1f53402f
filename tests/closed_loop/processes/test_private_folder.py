"""Folders in TMPDIR: what sweeps up those of killed programs, and what it leaves alone."""

import os
import shutil
import stat
import sys
import tempfile
import time
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.processes.private_folder import KEPT_S, private_folder

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such locks")


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def left_by_a_killed_program(place: Path, age_s: float = KEPT_S + 60.0) -> Path:
    """Return a folder as it was when its program was killed, which gave its lock back."""
    with private_folder("recordings") as folder:
        (folder / "lane1.log").write_text("a frame")
        left = place / "steer-by-wire-recordings-left"
        shutil.copytree(folder, left)
    made_old(left, age_s)
    return left


def made_old(folder: Path, age_s: float) -> None:
    at_s = time.time() - age_s
    for entry in (*folder.iterdir(), folder):
        os.utime(entry, (at_s, at_s))


def test_a_folder_is_private_and_goes_with_its_block(place: Path) -> None:
    with private_folder("bus") as folder:
        assert folder.parent == place
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert not list(place.iterdir())


def test_what_a_killed_program_has_left_is_removed_after_a_day(place: Path) -> None:
    left = left_by_a_killed_program(place)
    with private_folder("bus"):
        assert not left.exists()


def test_a_recording_that_a_killed_program_has_left_can_be_fetched_for_a_day(place: Path) -> None:
    left = left_by_a_killed_program(place, KEPT_S - 60.0)
    with private_folder("bus"):
        assert (left / "lane1.log").read_text() == "a frame"


def test_a_folder_whose_program_runs_stays_however_old(place: Path) -> None:
    with private_folder("recordings") as folder:
        made_old(folder, 30 * KEPT_S)
        with private_folder("bus"):
            assert len(list(place.iterdir())) == 2


def test_what_is_not_ours_stays(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without_lock = place / "steer-by-wire-of-somebody"
    without_lock.mkdir()
    target = left_by_a_killed_program(place).rename(place / "elsewhere")
    (place / "steer-by-wire-link").symlink_to(target)
    for folder in (without_lock, target):
        made_old(folder, 30 * KEPT_S)
    with private_folder("bus"):
        assert without_lock.exists()
        assert (target / "lane1.log").exists()
    other_user = left_by_a_killed_program(place)
    monkeypatch.setattr(os, "getuid", lambda: other_user.stat().st_uid + 1)
    with private_folder("bus"):
        assert other_user.exists()
