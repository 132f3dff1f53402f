"""Programs that tests start are forked, which saves the suite minutes."""

import subprocess
import sys

import pytest

from tests.support.suite import forked_programs

VERSION = [sys.executable, "-m", "steer_by_wire", "--version"]


def test_programs_are_forked(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = subprocess.run(VERSION, capture_output=True, check=True)  # the origin is there now

    def start(*_arguments: object) -> None:
        raise AssertionError("an interpreter was started")

    monkeypatch.setattr(forked_programs, "_USUAL", start)
    forked = subprocess.run(VERSION, capture_output=True, check=True)
    assert forked.stdout == usual.stdout
