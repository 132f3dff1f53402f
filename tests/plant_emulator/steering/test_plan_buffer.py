"""A plan of commands in the plant: which value acts at which sample, and what ends it."""

import pytest

from steer_by_wire.dbc.messages import SteeringStatus, SteeringStatusCode, encode
from steer_by_wire.plant_emulator.faults.settings import FaultSettings
from steer_by_wire.plant_emulator.faults.stage import FaultyNode
from tests.support.frames.made_messages import plan_of
from tests.support.nodes.plant_link import MS_NS, PERIOD_NS, START_NS, Link, link

VALUES = [0.01 * index for index in range(18)]


def send_plan(tested: Link, now_ns: int, first_sample: int, spacing: int, number: int) -> None:
    tested.tick_until(now_ns - 1)
    plan = plan_of(VALUES, plan_number=number, first_sample=first_sample % 256, spacing=spacing)
    tested.node.on_frame(encode(plan, number % 256), now_ns)


def wheel_rad(tested: Link) -> list[float]:
    return [status.wheel_angle_rad for _, status in tested.messages(SteeringStatus)]


def applied(tested: Link) -> list[int]:
    return [status.applied_counter for _, status in tested.messages(SteeringStatus)]


def test_a_plan_is_played_by_samples_with_straight_lines_between_two_values() -> None:
    tested = link(safety={"plan_ms_max": 600.0})
    send_plan(tested, START_NS + 21 * MS_NS, first_sample=0, spacing=4, number=7)
    tested.tick_until(START_NS + 40 * PERIOD_NS)
    wheel = wheel_rad(tested)
    # It came with sample 2, after that was taken.
    assert wheel[:3] == [0.0, 0.0, 0.0]
    assert wheel[3:41] == pytest.approx([0.0025 * sample for sample in range(3, 41)], abs=1e-5)
    assert applied(tested)[2:5] == [0, 7, 7]


def test_the_newest_plan_takes_over_at_the_sample_after_its_arrival() -> None:
    tested = link()
    send_plan(tested, START_NS + 21 * MS_NS, first_sample=0, spacing=4, number=1)
    send_plan(tested, START_NS + 41 * MS_NS, first_sample=3, spacing=1, number=2)
    tested.tick_until(START_NS + 8 * PERIOD_NS)
    assert applied(tested)[2:9] == [0, 1, 1, 2, 2, 2, 2]
    assert wheel_rad(tested)[4:7] == pytest.approx([0.01, 0.02, 0.03])


def test_a_plan_that_has_run_out_is_silence() -> None:
    tested = link(safety={"plan_ms_max": 600.0})
    send_plan(tested, START_NS, first_sample=0, spacing=2, number=0)
    tested.tick_until(START_NS + 130 * PERIOD_NS)
    codes = [status.status for _, status in tested.messages(SteeringStatus)]
    # Silence counts from sample 0, at which it came, and not from sample 34, its last.
    assert codes.index(SteeringStatusCode.HOLDING) == 14
    assert codes.index(SteeringStatusCode.FALLBACK) == 14 + 50
    assert tested.node.report()["safety"]["longest_silence_s"] == pytest.approx(1.3)
    assert wheel_rad(tested)[40] == pytest.approx(VALUES[17])
    assert wheel_rad(tested)[-1] < VALUES[17]


@pytest.mark.parametrize(("plan_ms_max", "last"), [(0.0, 0), (100.0, 10), (600.0, 60)])
def test_a_plan_is_played_no_longer_than_the_plant_permits(plan_ms_max: float, last: int) -> None:
    tested = link(safety={"plan_ms_max": plan_ms_max})
    send_plan(tested, START_NS, first_sample=0, spacing=15, number=0)
    tested.tick_until(START_NS + 64 * PERIOD_NS)
    wheel = wheel_rad(tested)
    assert wheel[: last + 1] == pytest.approx(
        [VALUES[1] * sample / 15 for sample in range(last + 1)], abs=1e-5
    )
    assert wheel[last:64] == [wheel[last]] * (64 - last)


def test_one_plan_does_not_end_a_fallback_but_five_do() -> None:
    tested = link()
    tested.command(START_NS, 0.0)
    silent_ns = START_NS + 800 * MS_NS
    for number in range(1, 6):
        send_plan(tested, silent_ns + number * PERIOD_NS, 80, spacing=4, number=number)
        tested.tick_until(silent_ns + (number + 1) * PERIOD_NS)
        status = tested.last(SteeringStatus).status
        ended = number == 5
        assert (status is not SteeringStatusCode.FALLBACK) == ended


def test_samples_are_counted_modulo_256() -> None:
    tested = link()
    for sample in range(270):
        send_plan(tested, START_NS + sample * PERIOD_NS + MS_NS, sample, 2, number=sample)
    # Each is played at the sample after its first, half a spacing further on.
    assert wheel_rad(tested)[1:] == pytest.approx([0.5 * VALUES[1]] * 269)


def test_a_damaged_late_or_repeated_plan_changes_nothing() -> None:
    tested = link()
    send_plan(tested, START_NS, first_sample=0, spacing=4, number=5)
    for number, flip in ((6, True), (5, False), (4, False)):
        plan = plan_of([0.5] * 18, plan_number=number, spacing=15)
        frame = encode(plan, number)
        if flip:
            frame = frame._replace(data=frame.data[:-1] + b"\xff")
        tested.node.on_frame(frame, START_NS + MS_NS)
    tested.tick_until(START_NS + 5 * PERIOD_NS)
    assert applied(tested)[1:] == [5] * 5
    rejected = tested.node.report()["rejected"]
    assert rejected == {"bad_crc": 1, "out_of_order": 1, "repeated": 1}


def test_faults_of_plans_begin_after_the_first_of_them() -> None:
    tested = link()
    lost = FaultSettings(
        kind="drop", direction="downlink", message="STEERING_PLAN", magnitude=1.0, onset_s=0.1
    )
    faulty = FaultyNode(tested.node, (lost,), seed=1)
    for number in range(40):
        plan = plan_of(VALUES, plan_number=number, spacing=4)
        tested.tick_until(START_NS + number * PERIOD_NS)
        faulty.on_frame(encode(plan, number), START_NS + number * PERIOD_NS + MS_NS)
    assert tested.node.report()["accepted"] == 10
    codes = [status.status for _, status in tested.messages(SteeringStatus)]
    # The last of them came before sample 10.
    assert codes.index(SteeringStatusCode.HOLDING) == 10 + 14
