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
    generate = [sys.executable, "-m", "cantools", "generate_c_source", str(DBC)]
    subprocess.run(generate, cwd=folder, check=True)
    sources = [str(HERE / "controller.c"), "steer_by_wire.c"]
    compiler = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-I.", *options]
    subprocess.run([*compiler, "-o", "controller", *sources, "-lm"], cwd=folder, check=True)
    return str(folder / "controller")


@pytest.mark.steer_by_wire(seeds=[1], overrides={"duration_s": 2.0, "safety.ftti_ms": "off"})
def test_it_holds_the_path(rig, tmp_path):
    rig.run([build(tmp_path), "{channel}"]).assert_holds(rms_m=0.1)


@pytest.mark.steer_by_wire(seeds=[1], overrides={"duration_s": 2.0})
def test_one_without_a_counter_is_found(rig, tmp_path):
    outcome = rig.run([build(tmp_path, "-DWITHOUT_COUNTER"), "{channel}"])
    with pytest.raises(AssertionError, match=r"(?s)fell back.*rejected: \d+ repeated"):
        outcome.assert_holds(rms_m=0.1)
