"""The controller in C under test, on a bus and in virtual time.

``steer-by-wire with-vcan python -m pytest test_controller.py`` runs both. The last test shows
that the rig finds a controller with an error: its commands all have the same counter, so that the
plant believes the first one only.
"""

import subprocess
import sys
from pathlib import Path

import pytest

MAKEFILE = Path(__file__).with_name("Makefile")


def build(folder: Path, program: str, *options: str) -> str:
    """Return the compiled program."""
    make = ["make", "-s", "-f", str(MAKEFILE), program]
    variables = [f"CFLAGS={' '.join(options)}", f"PYTHON={sys.executable}"]
    subprocess.run([*make, *variables], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return str(folder / program)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where tests of the same source compile it once."""
    return tmp_path_factory.mktemp("controller")


@pytest.mark.steer_by_wire(seeds=[1], overrides={"duration_s": 2.0, "safety.ftti_ms": "off"})
def test_it_holds_the_path(rig, folder):
    rig.run([build(folder, "on_vcan"), "{channel}"]).assert_holds(rms_m=0.1)


@pytest.mark.steer_by_wire(seeds=[1, 2], latency_s=0.02, overrides={"duration_s": 8.0})
def test_it_holds_the_path_in_virtual_time(rig, folder):
    rig.run([build(folder, "on_lockstep")], lockstep=True).assert_holds(rms_m=0.1)


@pytest.mark.steer_by_wire(seeds=[1], overrides={"duration_s": 2.0})
def test_one_without_a_counter_is_found_in_virtual_time(rig, folder):
    outcome = rig.run([build(folder, "broken", "-DWITHOUT_COUNTER")], lockstep=True)
    with pytest.raises(AssertionError, match=r"(?s)fell back.*rejected: \d+ repeated"):
        outcome.assert_holds(rms_m=0.1)
