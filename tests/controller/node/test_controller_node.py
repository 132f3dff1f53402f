"""The controller node against a stand-in for the plant, over a link that the test steps."""

import math
from itertools import pairwise
from typing import Any

import pytest

from steer_by_wire.controller.law_interface import LawInput, LawOutput
from steer_by_wire.controller.laws.law_from_settings import LawDesign
from steer_by_wire.controller.limits.steer_limits import SteerLimits
from steer_by_wire.controller.node.command_frames import IN_FLIGHT_MAX, CommandFrames
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.node.status_frames import STATUS_PERIOD_NS
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    ControllerSafety,
    ControllerStatus,
    DelayStatus,
    LateralError,
    Mode,
    ModelStatus,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    encode,
    encode_not_available,
)
from steer_by_wire.runtime.frame import Frame
from tests.support.frames.made_messages import command_of, error_of, message_with
from tests.support.loops.own_vehicle import VEHICLE
from tests.support.nodes.controller_link import (
    MS_NS,
    PERIOD_NS,
    START_NS,
    Link,
    controller_settings,
)
from tests.support.suite.combinations import combined


def link(**tables: Any) -> Link:
    return Link(ControllerNode(controller_settings(**tables), START_NS, samples_max=10_000))


def test_nothing_is_commanded_before_a_valid_measurement() -> None:
    plant = link()
    plant.drive(50, None)
    damaged = encode(error_of(0.1), 0)
    plant.node.on_frame(damaged._replace(data=bytes(8)), plant.now_ns)
    plant.node.on_frame(encode_not_available(error_of(), 0), plant.now_ns)
    plant.drive(1, None)
    assert plant.commands == []
    assert {type(message) for _, message, _ in plant.sent} == {
        ControllerStatus,
        ControllerSafety,
        DelayStatus,
    }
    plant.drive(1, 0.1)
    assert [command.mode for command in plant.commands] == [Mode.ACTIVE]


def test_every_period_has_one_command_on_the_grid_with_both_counters_stepping() -> None:
    plant = link()
    plant.drive(600, 0.01)
    commands = [entry for entry in plant.sent if isinstance(entry[1], SteeringCommand)]
    times_ns = [time_ns for time_ns, _, _ in commands]
    assert times_ns == [START_NS + index * PERIOD_NS for index in range(600)]
    assert [command.command_counter for command in plant.commands] == list(range(600))
    assert [counter for _, _, counter in commands] == [index % 256 for index in range(600)]


def test_the_status_reports_mode_law_and_counts_ten_times_a_second() -> None:
    plant = link()
    plant.drive(95, 0.01)
    statuses = [entry for entry in plant.sent if isinstance(entry[1], ControllerStatus)]
    assert [time_ns for time_ns, _, _ in statuses] == [
        START_NS + index * STATUS_PERIOD_NS for index in range(10)
    ]
    assert [counter for _, _, counter in statuses] == list(range(10))
    assert statuses[-1][1] == message_with(ControllerStatus, mode=Mode.ACTIVE)


def test_a_law_with_a_model_says_once_a_second_what_it_takes_its_vehicle_for() -> None:
    asked = controller_preset("highway_stiff_predictor", ["estimator.actuator_lag_s=0.05"])
    plant = Link(ControllerNode(asked, START_NS))
    plant.drive(201, 0.01)
    models = [entry for entry in plant.sent if isinstance(entry[1], ModelStatus)]
    as_set = message_with(ModelStatus, steering_lag_s=0.05, virtual_mass_kg=2000.0)
    seconds = range(0, 3000, 1000)
    assert models == [(START_NS + ms * MS_NS, as_set, ms // 1000) for ms in seconds]
    assert plant.node.report()["believed"] == {"steering_lag_s": 0.05, "virtual_mass_kg": 2000.0}


def test_a_late_tick_keeps_phase_and_counts_what_it_skipped() -> None:
    plant = link()
    plant.drive(3, 0.01)
    plant.now_ns += 4 * PERIOD_NS + 3 * MS_NS
    plant.deliver(error_of(0.01))
    plant.keep(plant.node.on_tick(plant.now_ns))
    assert plant.node.deadline_ns == START_NS + 8 * PERIOD_NS
    assert plant.node.report()["skipped_ticks"] == 4
    assert plant.node.report()["ticks"] == 4


def test_the_command_is_held_then_ramped_to_zero_when_measurements_stop() -> None:
    plant = link()
    plant.drive(20, 0.1)
    last_rad = plant.commands[-1].steer_rad
    assert last_rad == pytest.approx(-0.1, abs=1e-5)
    plant.drive(60, None)
    after = plant.commands[20:]
    # Arrived at the instant of the last ACTIVE tick: 50 ms later it still counts.
    assert [command.mode for command in after[:5]] == [Mode.ACTIVE] * 5
    held = [command for command in after if command.mode is Mode.HOLDING]
    assert [command.steer_rad for command in held] == [last_rad] * 10
    stopping = [command.steer_rad for command in after if command.mode is Mode.SAFE_STOP]
    assert len(stopping) == 60 - 5 - 10
    for before_rad, following_rad in pairwise([last_rad, *stopping]):
        assert following_rad == pytest.approx(min(0.0, before_rad + 0.01), abs=1.1e-5)
    assert stopping[-1] == 0.0


def test_recovery_needs_a_run_of_good_frames() -> None:
    plant = link()
    plant.drive(10, 0.1)
    plant.drive(30, None)
    assert plant.commands[-1].mode is Mode.SAFE_STOP
    plant.drive(2, 0.1)
    plant.node.on_frame(Frame(CAN_IDS[LateralError], bytes(8)), plant.now_ns)
    plant.drive(2, 0.1)
    assert [command.mode for command in plant.commands[-2:]] == [Mode.SAFE_STOP, Mode.ACTIVE]


@pytest.mark.parametrize("ahead", [0, -3, 120])
def test_frames_refused_for_their_counter_alone_leave_the_run_of_good_ones(ahead: int) -> None:
    plant = link()
    plant.drive(10, 0.1)
    plant.drive(30, None)
    for _ in range(3):
        plant.drive(1, 0.1)
        counter = (plant.counters[LateralError] - 1 + ahead) % 256
        plant.node.on_frame(encode(error_of(0.1), counter), plant.now_ns)
    assert sum(plant.node.report()["rejected"].values()) == 3
    assert [command.mode for command in plant.commands[-3:]] == [
        Mode.SAFE_STOP,
        Mode.SAFE_STOP,
        Mode.ACTIVE,
    ]


@pytest.mark.parametrize(
    ("law", "outage_periods"), combined(["pd", "pd_dob", "pd_cdob", "pd_ddob"], [8, 25, 200])
)
def test_recovery_makes_no_jump(law: str, outage_periods: int) -> None:
    """The rate limit is out of the way here: the fade alone keeps the command continuous."""
    plant = link(
        law=law,
        dob={"q_cutoff_rad_s": 2.0},
        cdob={"q_cutoff_rad_s": 10.0, "washout_rad_s": 1.0},
        nominal_model=VEHICLE.model_dump(),
        limits={"steer_rate_rad_s_max": 1000.0},
    )
    plant.drive(20, 0.2)
    plant.drive(outage_periods, None)
    resumed_at = len(plant.commands)
    plant.drive(200, -0.25)
    modes = [command.mode for command in plant.commands[resumed_at:]]
    assert modes.count(Mode.ACTIVE) == 198
    first = resumed_at + modes.index(Mode.ACTIVE)
    assert plant.commands[first].steer_rad == plant.commands[first - 1].steer_rad
    for before, following in pairwise(plant.node.samples[first - 1 :]):
        law_step_rad = abs(following.law_output.steer_rad - before.law_output.steer_rad)
        if before.mode is Mode.ACTIVE:
            command_step_rad = abs(following.sent_steer_rad - before.sent_steer_rad)
            assert command_step_rad <= law_step_rad + 0.01 + 1e-12
    last = plant.node.samples[-1]
    assert last.sent_steer_rad == pytest.approx(max(-0.6, min(0.6, last.law_output.steer_rad)))


def law_that_steers(
    monkeypatch: pytest.MonkeyPatch, *steers_rad: float, then_rad: float | None = None
) -> Link:
    """Return a node whose law steers so, and then by ``then_rad`` or by its first error [m]."""
    outputs = iter(steers_rad)

    def step(_p: None, x: float, observed: LawInput) -> tuple[float, LawOutput]:
        steer_rad = next(outputs, x if then_rad is None else then_rad)
        return x, LawOutput(steer_rad, 0.0, 0.0, observed.lateral_error_m)

    design = LawDesign(None, lambda error_m: error_m, step)
    monkeypatch.setattr(
        "steer_by_wire.controller.node.law_runner.design_law", lambda _settings: design
    )
    return link(limits={"steer_rate_rad_s_max": 1000.0})


@pytest.mark.parametrize("code", SteeringStatusCode)
def test_a_law_is_given_the_wheels_angle_where_the_steering_overrules_its_command(
    monkeypatch: pytest.MonkeyPatch, code: SteeringStatusCode
) -> None:
    given_rad: list[float] = []

    def step(_p: None, x: float, observed: LawInput) -> tuple[float, LawOutput]:
        given_rad.append(observed.sent_steer_rad)
        return x, LawOutput(0.3, 0.0, 0.0, observed.lateral_error_m)

    design = LawDesign(None, lambda error_m: error_m, step)
    monkeypatch.setattr(
        "steer_by_wire.controller.node.law_runner.design_law", lambda _settings: design
    )
    plant = link(limits={"steer_rate_rad_s_max": 1000.0})
    plant.drive(2, 0.2)
    plant.deliver(message_with(SteeringStatus, wheel_angle_rad=0.05, status=code))
    plant.drive(20, 0.2)
    overrules = code in (3, 5, 6, 7)
    # 135 ms after the status it is too old to be believed.
    expected = [0.0, 0.3, *([0.05 if overrules else 0.3] * 14), *([0.3] * 6)]
    assert given_rad == pytest.approx(expected)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_law_that_fails_is_counted_held_and_started_anew(
    monkeypatch: pytest.MonkeyPatch, bad: float
) -> None:
    plant = law_that_steers(monkeypatch, 0.1, 0.1, bad)
    plant.drive(3, 0.2)
    assert plant.commands[-1] == command_of(0.1, 2, Mode.HOLDING)
    plant.drive(20, 0.2)
    assert [command.mode for command in plant.commands[3:6]] == [
        Mode.HOLDING,
        Mode.HOLDING,
        Mode.ACTIVE,
    ]
    assert plant.commands[-1].steer_rad == pytest.approx(0.2)
    assert plant.node.report()["law_failures"] == 1


def test_a_law_that_fails_again_ends_in_the_safe_stop_for_good(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Measurements stay good: without this the last command would be held for ever."""
    plant = law_that_steers(monkeypatch, 0.1, 0.1, then_rad=math.nan)
    plant.drive(6, 0.2)
    assert [command.mode for command in plant.commands[2:]] == [
        Mode.HOLDING,
        Mode.HOLDING,
        Mode.HOLDING,
        Mode.SAFE_STOP,
    ]
    is_finished = [plant.node.finished]
    plant.drive(60, 0.2)
    is_finished.append(plant.node.finished)
    assert {command.mode for command in plant.commands[5:]} == {Mode.SAFE_STOP}
    assert plant.commands[-1].steer_rad == 0.0
    assert is_finished == [False, True]
    report = plant.node.report()
    assert report["law_failures"] == 2
    assert "not finite" in report["failure"]


def test_the_round_trip_is_from_sending_to_the_first_echo() -> None:
    plant = link()
    plant.drive(30, 0.01)
    for counter, echo_ms in ((10, 300), (10, 310), (12, 320)):
        plant.now_ns = START_NS + echo_ms * MS_NS
        plant.deliver(
            message_with(
                SteeringStatus, applied_counter=counter, status=SteeringStatusCode.APPLYING
            )
        )
    plant.deliver(
        message_with(SteeringStatus, applied_counter=20, status=SteeringStatusCode.NO_COMMAND)
    )
    figures = plant.node.report()["round_trip"]
    assert figures["samples"] == 2
    assert figures["mean_s"] == pytest.approx(0.2)
    assert figures["max_s"] == pytest.approx(0.2)


def test_what_was_never_sent_or_long_ago_has_no_echo() -> None:
    commands = CommandFrames(SteerLimits(0.6, 0.02), 1.0)
    assert commands.on_echo(0) is None
    for counter in range(IN_FLIGHT_MAX + 1):
        assert commands.on_sent(10 * counter) == counter
    assert commands.on_echo(0) is None
    assert commands.on_echo(IN_FLIGHT_MAX + 1) is None
    assert commands.on_echo(60_000) is None
    assert commands.on_echo(1) == (10, 0.0, True)
    assert commands.on_echo(1) == (10, 0.0, False)
    commands.on_sent(0)  # in the place of the one echoed
    assert commands.on_echo(1) is None
    assert commands.on_echo(IN_FLIGHT_MAX + 1) == (0, 0.0, True)


def test_the_report_books_time_by_mode_and_the_age_of_samples() -> None:
    plant = link()
    plant.drive(10, None)
    for _ in range(10):
        plant.tick_until(plant.now_ns + 6 * MS_NS)
        plant.deliver(error_of(0.01))
        plant.tick_until(plant.now_ns + 4 * MS_NS)
    plant.drive(30, None)
    report = plant.node.report()
    # The first measurement is used at 110 ms, the last one until it is 50 ms old, at 240 ms.
    assert report["mode_s"] == pytest.approx(
        {"waiting": 0.11, "active": 0.14, "holding": 0.1, "safe_stop": 0.14}
    )
    assert report["sample_age"]["samples"] == 14
    assert report["sample_age"]["p50_s"] == pytest.approx(0.004, rel=0.01)
    assert report["sample_age"]["max_s"] == pytest.approx(0.044)
    assert report["law"] == "pd"
    assert report["rate_hz"] == 100.0


def test_samples_are_kept_up_to_the_number_asked_for() -> None:
    node = ControllerNode(controller_settings(), START_NS, samples_max=5)
    plant = Link(node)
    plant.drive(10, 0.1)
    assert [sample.time_ns for sample in node.samples] == [
        START_NS + index * PERIOD_NS for index in range(5)
    ]
    assert node.samples[0].lateral_error_m == pytest.approx(0.1)
