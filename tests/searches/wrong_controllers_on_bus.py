"""Wrong controllers as programs on a bus: each is red for its reason, and right ones are green.

    steer-by-wire with-vcan python -m pytest -n 3 tests/searches/wrong_controllers_on_bus.py

On a real vcan0; without with-vcan, on this machine's vcan0 or an emulated bus. Takes half a minute
for each of 27 where the machine is not busy; on a busy one it shows what the load changes. Inside
User Mode Linux no program keeps 1 kHz: there the right paper_pd is red for its rate.
"""

import re
import sys
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.rig import Rig
from tests.support.attacks.wrong_controllers import RIGHT, WRONG

PLANT = {"duration_s": 16.0}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_controller_is_red(name: str, tmp_path: Path) -> None:
    program = [sys.executable, "-m", "tests.support.attacks.wrong_controllers", name]
    outcome = Rig(tmp_path, overrides=PLANT).run(
        [*program, "--preset", "practical_pd_ddob", "{bus}"]
    )
    with pytest.raises(AssertionError) as caught:
        outcome.assert_holds()
    # The words alone: how fast a program floods or doubles depends on the machine.
    assert str(caught.value).startswith(re.split(r"\d", WRONG[name][1])[0])


@pytest.mark.parametrize("preset", RIGHT)
def test_a_right_controller_passes(preset: str, tmp_path: Path) -> None:
    sensor_ms = 1.0 if preset == "paper_pd" else 10.0
    rig = Rig(tmp_path, overrides={**PLANT, "sensor_period_ms": sensor_ms})
    rig.run(preset, in_real_time=True).assert_holds(rms_m=0.1)
