"""The controller in C under test: ``steer-by-wire with-vcan python -m pytest test_controller.py``.

The second test shows that the rig finds a controller with an error: its commands all have the same
counter, so that the plant believes the first one only.
"""

import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
DBC = HERE.parents[1] / "dbc" / "steer_by_wire.dbc"


def build(folder: Path, *options: str) -> str:
    """Return the compiled controller."""
    compiler = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-I.", *options]
    if not (folder / "steer_by_wire.o").exists():
        generate = [sys.executable, "-m", "cantools", "generate_c_source", str(DBC)]
        subprocess.run(generate, cwd=folder, check=True)
        subprocess.run([*compiler, "-c", "steer_by_wire.c"], cwd=folder, check=True)
    sources = [str(HERE / "controller.c"), "steer_by_wire.o"]
    subprocess.run([*compiler, "-o", "controller", *sources, "-lm"], cwd=folder, check=True)
    return str(folder / "controller")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where both tests compile what they need."""
    return tmp_path_factory.mktemp("controller")


@pytest.mark.steer_by_wire(seeds=[1], overrides={"duration_s": 2.0, "safety.ftti_ms": "off"})
def test_it_holds_the_path(rig, folder):
    rig.run([build(folder), "{channel}"]).assert_holds(rms_m=0.1)


@pytest.mark.steer_by_wire(seeds=[1], overrides={"duration_s": 2.0})
def test_one_without_a_counter_is_found(rig, folder):
    outcome = rig.run([build(folder, "-DWITHOUT_COUNTER"), "{channel}"])
    with pytest.raises(AssertionError, match=r"(?s)fell back.*rejected: \d+ repeated"):
        outcome.assert_holds(rms_m=0.1)
