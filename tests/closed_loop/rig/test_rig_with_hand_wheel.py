"""A hand wheel in the rig: ours, or one under test, as a node or a program in lockstep."""

import sys
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.rig.rig import Rig
from steer_by_wire.closed_loop.scripting.simulate import settings_of
from steer_by_wire.hand_wheel.node import HandWheelNode
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.runtime.settings import SettingsError

CAR = Path(__file__).parents[2] / "dbc" / "dialect" / "my_car.toml"
DRIVEN = {"hand_wheel.steered_by": "driver"}
PROGRAM = [sys.executable, "-m", "tests.closed_loop.lockstep.lockstep_controller", "hands_off"]


def rig_of(folder: Path, uplink_s: float, duration_s: float) -> Rig:
    network = {"latency.uplink.mean_s": uplink_s, "duration_s": duration_s}
    return Rig(folder, "highway_nominal", network, seed=3)  # a double lane change


def test_a_wheel_that_shakes_fails_with_how_it_does(tmp_path: Path) -> None:
    rig_of(tmp_path / "still", 0.0, 9.0).run("highway_pd", hand_wheel="still").assert_wheel_still()
    rig = rig_of(tmp_path / "shakes", 0.2, 9.0)
    with pytest.raises(AssertionError, match=r"^the hand wheel shakes at 0\.\d Hz, ±\d"):
        rig.run("highway_pd", DRIVEN, hand_wheel="hands_off").assert_wheel_still()


def test_a_program_as_the_hand_wheel_makes_the_run_of_the_node(tmp_path: Path) -> None:
    rig = rig_of(tmp_path, 0.02, 1.5)
    settings = settings_of(HandWheelSettings, "hands_off", {})
    node, program = (
        rig.run("highway_pd", DRIVEN, hand_wheel=wheel).files.candump_log.read_bytes()
        for wheel in (lambda start_ns: HandWheelNode(settings, start_ns), PROGRAM)
    )
    assert node == program
    assert b" 180#" in node  # HAND_WHEEL_STATE


def test_a_hand_wheel_that_fails_or_is_missing_is_said(tmp_path: Path) -> None:
    rig = rig_of(tmp_path, 0.02, 0.5)
    ended = rig.run("highway_pd", hand_wheel=[sys.executable, "-c", "raise SystemExit(3)"])
    assert ended.ending.startswith("hand wheel at 0.000 s: python")
    with pytest.raises(AssertionError, match=r"^hand wheel at .*\nno HAND_WHEEL_STATE is on"):
        ended.assert_wheel_still()
    with pytest.raises(SettingsError, match=r"^hand_wheel: needs a preset or a settings file, in"):
        rig.run(["./my_controller"], lockstep=True, hand_wheel="still")
    with pytest.raises(SettingsError, match=r"^hand_wheel is of type int \(allowed: name of a"):
        rig.run("highway_pd", hand_wheel=3)  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match=r"^hand_wheel: a rig with a dialect has none$"):
        Rig(tmp_path, dialect=CAR).run("highway_pd", hand_wheel="still")
