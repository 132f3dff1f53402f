"""The suite itself: programs that tests start are forked; its last line counts what was skipped."""

import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.support.suite import forked_programs
from tests.support.suite.last_line import last_line

ROOT = Path(__file__).resolve().parents[3]
VERSION = [sys.executable, "-m", "steer_by_wire", "--version"]


def test_programs_are_forked(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = subprocess.run(VERSION, capture_output=True, check=True)  # the origin is there now

    def start(*_arguments: object) -> None:
        raise AssertionError("an interpreter was started")

    monkeypatch.setattr(forked_programs, "_USUAL", start)
    forked = subprocess.run(VERSION, capture_output=True, check=True)
    assert forked.stdout == usual.stdout


def skipped(reason: str) -> SimpleNamespace:
    return SimpleNamespace(longrepr=("tests/test_some.py", 7, f"Skipped: {reason}"))


def test_it_counts_what_has_passed_and_groups_what_has_not_run_by_its_reason() -> None:
    reports = {
        "passed": [SimpleNamespace()] * 3,
        "skipped": [skipped("no bus"), skipped("no compiler"), skipped("no bus")],
    }
    assert last_line(reports) == "3 passed, 3 skipped (2: no bus; 1: no compiler)"


def test_it_counts_what_has_failed() -> None:
    reports = {"failed": [SimpleNamespace()], "error": [SimpleNamespace()] * 2}
    assert last_line(reports) == "0 passed, 1 failed, 2 errors, 0 skipped"


def test_every_module_that_the_suite_knows_by_name_is_there() -> None:
    named = re.findall(r'"(test_\w+)"', (ROOT / "tests" / "conftest.py").read_text("utf-8"))
    there = {
        file.stem for folder in ("tests", "packaging") for file in (ROOT / folder).rglob("*.py")
    }
    assert len(named) > 20
    assert {*named} <= there
