"""A rig whose bus speaks a car's messages."""

from functools import partial
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.rig import Rig
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.dialect.dialect import read_dialect
from steer_by_wire.dbc.dialect.gateway import Gateway
from steer_by_wire.runtime.node.end import End

CAR = Path(__file__).parents[2] / "dbc" / "dialect" / "my_car.toml"
SETTINGS = controller_preset("practical_pd")


def foreign(start_ns: int) -> Gateway[ControllerNode]:
    """A controller that speaks the car's messages of itself."""
    return Gateway(ControllerNode(SETTINGS, start_ns), read_dialect(CAR), End.CONTROLLER, start_ns)


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path, overrides={"duration_s": 2.0}, dialect=CAR)


def test_it_drives_ours_and_one_that_speaks_it(rig: Rig) -> None:
    ours, other = rig.run("practical_pd"), rig.run(foreign)
    for outcome in (ours, other):
        outcome.assert_holds(rms_m=0.1)
    assert ours.files.candump_log.read_bytes() == other.files.candump_log.read_bytes()
    assert ours.rate_hz == 100.0


def test_one_that_speaks_our_messages_never_drives(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("steer_by_wire.closed_loop.rig.rig.START_S_MAX", 3)
    outcome = rig.run(partial(ControllerNode, SETTINGS))
    with pytest.raises(AssertionError, match="the plant was never driven"):
        outcome.assert_holds()


def test_commands_at_another_rate_are_found(rig: Rig) -> None:
    outcome = rig.run(foreign)._replace(rate_hz=1000.0)
    with pytest.raises(AssertionError, match="commands at 100 Hz instead of 1000 Hz"):
        outcome.assert_holds()


def test_what_a_car_does_not_say_is_not_demanded(rig: Rig) -> None:
    outcome = rig.run("practical_pd")
    why = "my_car.toml: a car's messages have neither echo nor mode for this"
    with pytest.raises(AssertionError, match=why):
        outcome.assert_round_trip(p99_ms=50.0)
    with pytest.raises(AssertionError, match=why):
        outcome.assert_detects("silence", within_ms=50.0)
