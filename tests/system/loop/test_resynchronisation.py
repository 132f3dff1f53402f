"""A sequence of counters that does not go on from the last one is accepted after a hold."""

from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.messages import Mode, SteeringStatus, SteeringStatusCode
from steer_by_wire.plant_emulator.steering.settings import SafetySettings
from steer_by_wire.plant_emulator.steering.settings import resync_ns_of as plant_resync_ns_of
from tests.support.frames.made_messages import error_of
from tests.support.nodes.controller_link import MS_NS, PERIOD_NS, Link, controller_settings
from tests.support.nodes.plant_link import START_NS, link


def test_the_times_follow_from_the_fault_tolerant_time() -> None:
    assert controller_settings(supervision={}).counters.resync_ns == 145 * MS_NS + 1
    assert plant_resync_ns_of(SafetySettings()) == 140 * MS_NS + 1
    short = controller_settings(supervision={"fault_tolerant_time_ms": 100.0})
    assert short.counters.resync_ns == 95 * MS_NS + 1
    assert plant_resync_ns_of(SafetySettings(ftti_ms=100.0)) == 90 * MS_NS + 1
    assert plant_resync_ns_of(SafetySettings(ftti_ms="off")) == 0
    unlimited = controller_settings(supervision={"vehicle_state_timeout_ms": "off"})
    assert unlimited.counters.resync_ns == 145 * MS_NS + 1


def modes_after_a_jump(settings: ControllerSettings, phase_ns: int) -> list[Mode]:
    """The commands' modes when the measurements' counters jump back, so late in each period."""
    tested = Link(ControllerNode(settings, 7 * MS_NS))
    tested.drive(20, 0.1)
    tested.tick_until(tested.now_ns + phase_ns)
    sent = len(tested.commands)
    tested.deliver(error_of(0.1), skip=156)
    for _ in range(40):
        tested.tick_until(tested.now_ns + PERIOD_NS)
        tested.deliver(error_of(0.1))
    return [command.mode for command in tested.commands[sent:]]


def test_the_controller_holds_before_it_steers_by_a_stream_that_does_not_go_on() -> None:
    settings = controller_settings(supervision={})
    for phase_ns in (0, 1, 4 * MS_NS, 5 * MS_NS, 5 * MS_NS + 1, PERIOD_NS - 1):
        modes = modes_after_a_jump(settings, phase_ns)
        held = [index for index, mode in enumerate(modes) if mode is Mode.HOLDING]
        assert set(modes) == {Mode.ACTIVE, Mode.HOLDING}, phase_ns
        # It holds in time, and comes back by the run of good frames after the silence.
        assert 11 <= held[0] <= 14
        assert held == list(range(held[0], held[-1] + 1))
        assert 5 <= len(held) <= 7
        assert modes[-1] is Mode.ACTIVE


def test_the_steering_holds_before_it_follows_a_stream_that_does_not_go_on() -> None:
    tested = link()
    for step in range(60):
        if step == 20:
            tested.counter += 156
        tested.command(START_NS + step * PERIOD_NS, 0.1)
    tested.tick_until(START_NS + 60 * PERIOD_NS)
    codes = [status.status for _, status in tested.messages(SteeringStatus)]
    assert codes.count(SteeringStatusCode.HOLDING) >= 1
    report = tested.node.report()
    assert report["resynchronised"] == 1
    assert report["safety"]["holdings"] == 1
    # Accepted are the 20 before, and those that come more than 140 ms after the last of them.
    assert report["accepted"] == 20 + 60 - 34
