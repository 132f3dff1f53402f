"""Who steers: the rule by the driver's torque, and what the controller makes of it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.controller.who_steers import (
    HandWheelSettings,
    Steering,
    SteeringRule,
    assist_n_m,
    steering_rule,
    steering_step,
)
from steer_by_wire.dbc.messages import SteeredBy
from steer_by_wire.runtime.node import NEVER_NS

LAW, DRIVER, BOTH = SteeredBy.LAW, SteeredBy.DRIVER, SteeredBy.BOTH
PERIOD_NS = 10_000_000
FRESH = PERIOD_NS


def rule(**table: object) -> SteeringRule:
    return steering_rule(HandWheelSettings.model_validate(table), 0.01)


def history(
    p: SteeringRule, torques: list[float], *, age_ns: int = FRESH, can_steer: bool = True
) -> list[SteeredBy]:
    steering, found = Steering(LAW, 0, 0.0), []
    for period, torque in enumerate(torques):
        steering = steering_step(p, steering, torque, age_ns, period * PERIOD_NS, can_steer)
        found.append(SteeredBy(steering.steered_by))
    return found


def test_a_firm_torque_takes_over_and_rested_hands_give_back() -> None:
    p = rule(take_over_n_m=2.0, hands_off_n_m=0.3, hand_back_s=0.5)
    found = history(p, [1.9] * 5 + [-2.0] + [0.4] * 20 + [0.2] * 60)
    assert found == [LAW] * 5 + [DRIVER] * 70 + [LAW] * 11
    given_back = steering_step(p, Steering(DRIVER, 0, 0.0), 0.0, FRESH, 500_000_000, True)
    assert given_back.takes_over
    assert not steering_step(p, given_back, 0.0, FRESH, 510_000_000, True).takes_over


@given(st.lists(st.floats(-20.0, 20.0), max_size=50), st.sampled_from(["driver", "law"]))
def test_who_always_steers_steers_whatever_the_torque(torques: list[float], who: str) -> None:
    found = history(rule(steered_by=who), torques, can_steer=False)
    assert set(found) <= {SteeredBy[who.upper()]}


@given(st.lists(st.floats(-20.0, 20.0), max_size=50), st.sampled_from([NEVER_NS, 101_000_000]))
def test_a_silent_hand_wheel_never_steers(torques: list[float], age_ns: int) -> None:
    for who in ("driver", "torque"):
        assert set(history(rule(steered_by=who), torques, age_ns=age_ns)) <= {LAW}


@pytest.mark.parametrize("torque", [0.0, 5.0])
def test_the_driver_steers_while_the_law_cannot(torque: float) -> None:
    assert history(rule(hand_back_s=0.0), [torque] * 5, can_steer=False) == [DRIVER] * 5


def test_both_steer_until_a_firm_torque_and_again_after_rest() -> None:
    p = rule(steered_by="both", take_over_n_m=2.0, hand_back_s=0.5)
    found = history(p, [1.5] * 5 + [2.5] + [0.4] * 20 + [0.0] * 60)
    assert found == [BOTH] * 5 + [DRIVER] * 70 + [BOTH] * 11
    assert set(history(p, [0.0] * 5, can_steer=False)) == {DRIVER}
    assert set(history(p, [0.0] * 5, age_ns=NEVER_NS)) == {LAW}


@given(st.lists(st.tuples(st.booleans(), st.floats(-0.1, 0.1), st.floats(-5.0, 5.0)), max_size=80))
def test_the_assist_is_limited_and_never_jumps(steps: list[tuple[bool, float, float]]) -> None:
    p, steering = rule(steered_by="both", hand_back_s=0.0), Steering(BOTH, 0, 0.0)
    for period, (both, wanted, angle) in enumerate(steps):
        torque, before = (0.0 if both else 5.0), steering.share
        steering = steering_step(p, steering, torque, FRESH, period * PERIOD_NS, True)
        assert abs(assist_n_m(p, steering, wanted, angle, 0.0)) <= steering.share * p.torque_n_m_max
        assert abs(steering.share - before) <= 0.021


def test_the_assist_turns_the_wheel_to_the_command() -> None:
    p, steering = rule(steered_by="both", steering_ratio=10.0), Steering(BOTH, 0, 1.0)
    assert assist_n_m(p, steering, 0.01, 0.05, 0.0) == pytest.approx(20.0 * 0.05)
    assert assist_n_m(p, steering, 0.01, 0.1, 0.5) == pytest.approx(-0.5)
    assert assist_n_m(p, Steering(DRIVER, 0, 0.0), 0.01, 0.1, 0.5) == 0.0
