"""Programs that tests start are forked, which saves the suite minutes."""

import os
import subprocess
import sys

import pytest

import steer_by_wire.closed_loop.compiled.compilation  # noqa: F401 - it sets a variable of numba's
from tests.support import forked_programs

VERSION = [sys.executable, "-m", "steer_by_wire", "--version"]


def test_programs_are_forked_also_where_compiled_runs_were_imported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert os.environ["NUMBA_OPT"]
    usual = subprocess.run(VERSION, capture_output=True, check=True)  # the origin is there now

    def start(*_arguments: object) -> None:
        raise AssertionError("an interpreter was started")

    monkeypatch.setattr(forked_programs, "_USUAL", start)
    forked = subprocess.run(VERSION, capture_output=True, check=True)
    assert forked.stdout == usual.stdout
