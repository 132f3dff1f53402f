"""Rigs side by side in two processes: each has a bus of its own, and all of it ends."""

import os
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

import pytest

from tests.support.programs.running_program import wait_until

pytest_plugins = ["pytester"]

MARK = "STEER_BY_WIRE_TEST"
"""An environment variable, by which processes are found that the tests have started."""
TESTS = """
import pytest

@pytest.mark.parametrize("number", range(2))
@pytest.mark.steer_by_wire(bus="emulated", overrides={"duration_s": 1.0})
def test_it(rig, number):
    rig.run(["sleep", "1000"])
"""


def started(mark: str) -> list[int]:
    """Return the processes whose environment has the mark."""
    wanted, found = f"{MARK}={mark}".encode(), []
    for folder in Path("/proc").iterdir():
        with suppress(OSError):
            if folder.name.isdecimal() and wanted in (folder / "environ").read_bytes():
                found.append(int(folder.name))
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="processes are found in /proc")
def test_two_rigs_at_once_have_a_bus_each_and_leave_nothing_when_they_are_killed(
    pytester: pytest.Pytester,
) -> None:
    pytester.makepyfile(TESTS)
    mark = uuid4().hex
    # Not below pytester's folder: the path of a socket may have 107 bytes.
    temporary = Path(tempfile.mkdtemp())
    command = [sys.executable, "-m", "pytest", "-n", "2", "--basetemp", "runs"]
    environment = {**os.environ, MARK: mark, "TMPDIR": str(temporary)}
    with subprocess.Popen(
        command, cwd=pytester.path, env=environment, stdout=subprocess.DEVNULL
    ) as process:

        def ready() -> int:
            assert process.poll() is None
            printed = pytester.path.glob("runs/**/run1/plant_emulator.txt")
            return sum("ready" in file.read_text() for file in printed)

        try:
            wait_until(lambda: ready() == 2, "two plants are ready")
            assert len(list(temporary.glob("*"))) >= 2, "each bus has a folder"
            wait_until(lambda: len(started(mark)) >= 1 + 2 * 4, "each has bus, plant and command")
        finally:
            process.kill()
    wait_until(lambda: started(mark) == [], "all processes have ended")
    wait_until(lambda: list(temporary.iterdir()) == [], "their folders are gone")
    temporary.rmdir()
