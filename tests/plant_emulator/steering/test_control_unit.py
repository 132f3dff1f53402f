"""The steering's control unit in the plant: what it does with commands, counts and reports."""

import random
from typing import Any

import pytest

from steer_by_wire.dbc.messages import (
    Direction,
    Mode,
    PlantStatus,
    SafetyState,
    SteeringStatus,
    SteeringStatusCode,
    encode,
)
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.settings import SettingsError, load_settings
from tests.support.frames.made_messages import command_of, latency_of
from tests.support.nodes.driven_guard import Guarded, answers_to
from tests.support.nodes.plant_link import MS_NS, PERIOD_NS, START_NS, Link, link


def test_which_commands_are_followed_is_known_from_their_times() -> None:
    guarded = Guarded(recovery_frames=2, hold_ms=20.0, override_ms=700.0)
    times_ms = [0.0, 140.0, 280.0 + 1e-6, 281.0, 420.0, 600.0, 610.0, 699.0, 700.0, 710.0]
    expected = [guarded.command(time_ms, 0.25) for time_ms in times_ms]
    assert expected == [True, True, True, True, True, False, True, True, True, False]
    assert [
        answer.is_followed
        for answer in answers_to(guarded.p, [(round(t * MS_NS), False) for t in times_ms])
    ] == expected


# In the plant


DEAD_NS = START_NS + 500 * MS_NS


def silent(**tables: Any) -> Link:
    """A link whose controller commands 0.1 rad every 10 ms for half a second and then dies."""
    tested = link(**tables)
    for step in range(51):
        tested.command(START_NS + step * PERIOD_NS, 0.1)
    return tested


def codes(tested: Link) -> list[tuple[float, SteeringStatusCode]]:
    """Changes of STEERING_STATUS.STATUS, and when they were sent after the last command [ms]."""
    found: list[tuple[float, SteeringStatusCode]] = []
    for now_ns, message in tested.messages(SteeringStatus):
        if not found or found[-1][1] is not message.status:
            found.append(((now_ns - DEAD_NS) / MS_NS, message.status))
    return found


def test_silence_is_acted_upon_and_reported_within_the_fault_tolerant_time() -> None:
    tested = silent()
    tested.tick_until(START_NS + 300 * PERIOD_NS)
    held, fell = codes(tested)[-2:]
    assert held == (140.0, SteeringStatusCode.HOLDING)
    assert fell == (640.0, SteeringStatusCode.FALLBACK)
    wheel = {round((s.time_s - 0.5) * 1e3): s.wheel_angle_rad for s in tested.node.samples}
    assert wheel[140] == wheel[630] == 0.1
    assert wheel[640] == pytest.approx(0.098)
    assert wheel[1130] == pytest.approx(0.0, abs=1e-12)
    report = tested.node.report()["safety"]
    assert (report["mode"], report["holdings"], report["fallbacks"]) == ("fallback", 1, 1)
    reported = [(now_ns - DEAD_NS, m.safety) for now_ns, m in tested.messages(PlantStatus)]
    # At once, and then at five cycles.
    assert next(at for at, state in reported if state is SafetyState.HOLDING) == 140 * MS_NS
    assert [state for at, state in reported if 140 * MS_NS <= at < 640 * MS_NS] == [
        SafetyState.HOLDING
    ] * 6
    assert reported[-1][1] is SafetyState.FALLBACK


def test_silence_counts_behind_the_latency_line() -> None:
    """Constant latency is none; a latency that rises by 200 ms at once is 210 ms without one."""
    steady = silent(latency={"downlink": {"mean_s": 0.4}})
    assert steady.node.report()["safety"]["holdings"] == 0
    for rise_ms, holdings in ((100, 0), (130, 0), (140, 1), (200, 1)):
        tested = link()
        for step in range(100):
            if step == 50:
                rise = latency_of(Direction.DOWNLINK, rise_ms * 1e-3)
                tested.configure(START_NS + step * PERIOD_NS, rise)
            tested.command(START_NS + step * PERIOD_NS, 0.1)
        report = tested.node.report()["safety"]
        assert (rise_ms, report["holdings"]) == (rise_ms, holdings)
        assert report["longest_silence_s"] == pytest.approx((rise_ms + 10) * 1e-3)
        assert report["recoveries"] == holdings


@pytest.mark.parametrize("ahead", [0, -3, 120])
def test_commands_refused_for_their_counter_alone_leave_the_run_of_good_ones(ahead: int) -> None:
    """Repeated, out of order, too far: a network that doubles every command must not end it."""
    tested = silent(safety={"hold_ms": 100.0})
    back_ns = START_NS + 100 * PERIOD_NS
    for step in range(12):
        now_ns = back_ns + step * PERIOD_NS
        tested.command(now_ns, 0.0)
        number = tested.counter - 1 + ahead
        again = command_of(0.0, number % 65_536)
        tested.node.on_frame(encode(again, number % 256), now_ns)
    tested.tick_until(back_ns + 12 * PERIOD_NS)
    report = tested.node.report()
    assert sum(report["rejected"].values()) == 12
    assert report["safety"]["ignored_commands"] == 4


def test_commands_of_a_controller_that_stops_safely_are_followed() -> None:
    tested = link()
    tested.tick_until(START_NS)
    for step in range(20):
        message = command_of(0.2 - 0.01 * step, step, Mode.SAFE_STOP)
        tested.tick_until(START_NS + step * PERIOD_NS)
        tested.node.on_frame(encode(message, step), START_NS + step * PERIOD_NS)
    tested.tick_until(START_NS + 20 * PERIOD_NS)
    assert tested.node.samples[-1].wheel_angle_rad == pytest.approx(0.01)
    assert tested.last(SteeringStatus).status is SteeringStatusCode.APPLYING


def test_a_wheel_that_does_not_follow_is_a_fault_within_the_fault_tolerant_time() -> None:
    """A dead band stands for a steering that is stuck: the wheel lies 0.3 rad short."""
    tested = link(actuator={"dead_band_rad": 0.3})
    for step in range(40):
        tested.command(START_NS + step * PERIOD_NS, 0.5 if step else 0.0)
    tested.tick_until(START_NS + 40 * PERIOD_NS)
    safe_state = tested.node.report()["safety"]["safe_state"]
    assert safe_state["cause"] == "the wheel does not follow"
    assert 0.11 <= safe_state["at_s"] <= 0.13  # the command came 0.01 s after the start
    assert tested.last(SteeringStatus).status is SteeringStatusCode.SAFE_STATE
    assert tested.last(PlantStatus).safety is SafetyState.SAFE_STATE


@pytest.mark.parametrize(
    "actuator",
    [
        {"lag_s": 0.3},
        {"rate_limit_rad_s": 0.1},
        {"angle_limit_rad": 0.1},
        {"lag_s": 0.2, "rate_limit_rad_s": 0.2, "angle_limit_rad": 0.3, "dead_band_rad": 0.05},
    ],
    ids=str,
)
def test_a_slow_or_short_actuator_is_no_fault(actuator: dict[str, float]) -> None:
    tested = link(actuator=actuator)
    for step in range(1500):
        tested.command(START_NS + step * PERIOD_NS, 0.6 if step % 1000 < 500 else -0.6)
    assert tested.node.report()["safety"]["safe_state"] is None


def test_at_60_km_h_the_limits_bind_and_are_counted_and_reported_by_cause() -> None:
    """g = 70.8: 3 m/s² is 0.0424 rad, and 5 m/s³ over half a second 0.0353 rad."""
    tested = link(vehicle={"speed_m_s": 60.0 / 3.6})
    tested.command(START_NS, 0.2)
    tested.tick_until(START_NS)
    assert tested.last(SteeringStatus).wheel_angle_rad == pytest.approx(0.0353, abs=1e-4)
    assert tested.last(SteeringStatus).status is SteeringStatusCode.LIMITED_BY_SAFETY
    for step in range(1, 80):
        tested.command(START_NS + step * PERIOD_NS, 0.2)
    tested.tick_until(START_NS + 80 * PERIOD_NS)
    assert tested.last(SteeringStatus).wheel_angle_rad == pytest.approx(0.0424, abs=1e-4)
    counts = tested.node.report()["safety"]["interventions"]
    assert counts == {"lateral_acceleration": 5, "lateral_jerk": 75}
    states = [message.safety for _, message in tested.messages(PlantStatus)]
    assert states[1:8] == [SafetyState.LIMITING] * 7


@pytest.mark.parametrize("speed_km_h", [4.0, 5.0, 7.0])
def test_at_walking_speed_the_default_limits_let_the_wildest_commands_through(
    speed_km_h: float,
) -> None:
    """To and fro between the ends of what controllers may command by default, in 1 ms."""
    source = random.Random(7)
    tested = link(vehicle={"speed_m_s": speed_km_h / 3.6})
    for step in range(1000):
        tested.command(
            START_NS + step * MS_NS, source.choice([-0.6, 0.6, source.uniform(-0.6, 0.6)])
        )
    report = tested.node.report()["safety"]
    assert report["interventions"] == {}
    assert report["holdings"] == 0


OFF = (
    *("angle_rad_max", "angle_rate_rad_s_max", "follow_tolerance_rad", "ftti_ms"),
    *("lateral_acceleration_m_s2_max", "lateral_jerk_m_s3_max"),
)


@pytest.mark.parametrize("key", OFF)
@pytest.mark.parametrize("value", ["-1", "never"])
def test_a_bad_limit_is_reported_in_one_line(key: str, value: str) -> None:
    with pytest.raises(SettingsError) as caught:
        load_settings(PlantSettings, overrides=[f"safety.{key}={value}"])
    (line,) = caught.value.mistakes
    assert f"safety.{key} = " in line
    assert "number from" in line
    assert line.endswith("or off)")
