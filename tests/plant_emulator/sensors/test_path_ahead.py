"""The path ahead on the bus, and in the controller's history."""

import pytest

from steer_by_wire.dbc.messages import PathAhead, VehicleState
from steer_by_wire.plant_emulator.path.path import curvature
from steer_by_wire.plant_emulator.sensors.path_ahead import VALUES, spacing_m
from steer_by_wire.plant_emulator.settings import PlantSettings
from tests.support.frames.made_messages import path_ahead_of
from tests.support.nodes.fed_history import PERIOD_NS as TICK_NS
from tests.support.nodes.fed_history import FedHistory
from tests.support.nodes.plant_link import PERIOD_NS, START_NS, link

LANE_CHANGE = {"kind": "single_lane_change", "start_m": 5.0, "offset_m": 3.5, "length_m": 30.0}


def test_it_is_sent_only_if_the_settings_say_so() -> None:
    assert PlantSettings().path_ahead is None
    tested = link(path=LANE_CHANGE)
    tested.tick_until(START_NS + 10 * PERIOD_NS)
    assert tested.messages(PathAhead) == []


def test_the_values_are_the_curvature_at_equal_distances_of_the_sample_named() -> None:
    tested = link(
        path=LANE_CHANGE,
        vehicle={"speed_m_s": 5.0},
        path_ahead={"reach_s": 2.0},
        start_on_first_command=False,
    )
    tested.tick_until(START_NS + 300 * PERIOD_NS)
    messages = tested.messages(PathAhead)
    assert len(messages) == len(tested.messages(VehicleState)) == 151
    for number, (_, (sample, spacing, *values)) in enumerate(messages):
        assert sample == 2 * number % 256
        assert spacing == pytest.approx(0.4)
        ahead_m = [0.1 * number + 0.4 * index for index in range(VALUES)]
        expected = [curvature(tested.node.path, at_m) for at_m in ahead_m]
        assert values == pytest.approx(expected, abs=2.6e-5)


def test_the_spacing_reaches_as_far_as_asked_within_the_signal() -> None:
    assert spacing_m(16.0, 1.5) == pytest.approx(1.0)
    assert spacing_m(0.1, 1.0) == pytest.approx(0.05)
    assert spacing_m(80.0, 10.0) == pytest.approx(12.75)


def test_the_history_knows_the_curvature_of_samples_to_come() -> None:
    fed = FedHistory()
    for number in range(6):
        fed.sample(number, None)
        fed.command(number, 0.0)
    ahead = [0.001 * index for index in range(VALUES)]
    assert fed.loop_delay(5).path_end == -1
    fed.history.on_path(path_ahead_of(ahead, path_sample=4, path_spacing_m=1.0), 10.0)
    loop_delay, history = fed.history.loop_delay(5, 5 * TICK_NS), fed.history.history
    assert loop_delay.path_end == 4 + 250
    known = [history.curvature_1_m[sample] for sample in (0, 4, 9, 14, 254)]
    assert known == pytest.approx([0.0, 0.0, 0.0005, 0.001, 0.025])
    # Of one that names a sample on the other side of the counter's wrap, only the future counts.
    fed.history.on_path(path_ahead_of(ahead, path_sample=254, path_spacing_m=1.0), 10.0)
    assert fed.history.loop_delay(5, 5 * TICK_NS).path_end == -2 + 250
