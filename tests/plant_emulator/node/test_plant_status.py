"""PLANT_STATUS reports a change of SAFETY at once, and does not flood the bus."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.messages import CAN_IDS, PlantStatus, SafetyState, SteeringStatus
from steer_by_wire.plant_emulator.node.plant_status import (
    INTERVAL_NS,
    PERIOD_NS,
    PlantStatusReports,
)
from tests.support.nodes.plant_link import MS_NS, START_NS, Link, link, steered
from tests.support.nodes.plant_link import PERIOD_NS as SENSOR_NS

NORMAL, LIMITING, HOLDING, FALLBACK, SAFE_STATE = SafetyState


def changes(tested: Link) -> list[tuple[float, SafetyState]]:
    """Times since the start [ms] at which a change of SAFETY was reported."""
    found: list[tuple[float, SafetyState]] = []
    for now_ns, message in tested.messages(PlantStatus):
        if not found or found[-1][1] is not message.safety:
            found.append(((now_ns - START_NS) / MS_NS, message.safety))
    return found


def drive(states: list[tuple[int, SafetyState]], until_ns: int) -> list[tuple[int, SafetyState]]:
    """Let SAFETY change at these times [ns]; returns what was reported when."""
    telling, state, pending = PlantStatusReports(0), NORMAL, list(states)
    sent: list[tuple[int, SafetyState]] = []
    while True:
        change_ns = pending[0][0] if pending else until_ns
        now_ns = min(change_ns, telling.deadline_ns)
        if now_ns >= until_ns:
            return sent
        if change_ns == now_ns:
            state = pending.pop(0)[1]
        else:
            telling.on_report(state, now_ns, now_ns)
            sent.append((now_ns, state))
            state = NORMAL if state is LIMITING else state
        telling.on_state(state, now_ns)


def test_silence_is_reported_at_the_instant_at_which_it_is_found() -> None:
    """The last command comes at 500 ms; the cycle at 700 ms would be 60 ms later."""
    tested = link()
    for step in range(51):
        tested.command(START_NS + step * SENSOR_NS, 0.1)
    tested.tick_until(START_NS + 1300 * MS_NS)
    assert changes(tested) == [(0.0, NORMAL), (640.0, HOLDING), (1140.0, FALLBACK)]
    cycles = [at for at, _ in tested.messages(PlantStatus)]
    assert {START_NS + step * PERIOD_NS for step in range(14)} < set(cycles)
    assert len(cycles) == 16
    counters = [frame.data[2] for _, frame in tested.frames if frame.can_id == CAN_IDS[PlantStatus]]
    assert counters == list(range(16))


@pytest.mark.parametrize("latency_ms", [0, 50])
def test_it_takes_no_way_through_the_uplink_as_steering_status_does(latency_ms: int) -> None:
    tested = link(latency={"uplink": {"mean_s": latency_ms * 1e-3}})
    for step in range(51):
        tested.command(START_NS + step * SENSOR_NS, 0.1)
    tested.tick_until(START_NS + 800 * MS_NS)
    assert changes(tested)[-1] == (640.0, HOLDING)
    codes = [(at, message.status.name) for at, message in tested.messages(SteeringStatus)]
    first_ns = next(at for at, name in codes if name == "HOLDING")
    assert first_ns == START_NS + (640 + latency_ms) * MS_NS


def test_a_late_tick_reports_what_was_due_meanwhile() -> None:
    tested = link()
    tested.command(START_NS, 0.1)
    tested.tick_until(START_NS + 100 * MS_NS)
    tested.tick(START_NS + 390 * MS_NS)
    assert changes(tested) == [(0.0, NORMAL), (390.0, HOLDING)]


def test_a_limit_that_acts_all_the_time_costs_one_frame_more() -> None:
    tested = steered(100, vehicle={"speed_m_s": 60.0 / 3.6})
    states = [message.safety for _, message in tested.messages(PlantStatus)]
    assert states[:3] == [NORMAL, LIMITING, LIMITING]
    assert set(states[1:]) == {LIMITING}
    assert len(states) == 12


@pytest.mark.parametrize(
    ("sent", "state", "after_ns"),
    [
        *((NORMAL, worse, 1) for worse in (HOLDING, SAFE_STATE)),
        *((NORMAL, LIMITING, INTERVAL_NS), (LIMITING, NORMAL, PERIOD_NS), (LIMITING, HOLDING, 1)),
        *((HOLDING, better, INTERVAL_NS) for better in (NORMAL, LIMITING)),
        *((HOLDING, worse, 1) for worse in (FALLBACK, SAFE_STATE)),
        *((FALLBACK, better, INTERVAL_NS) for better in (HOLDING, NORMAL)),
        *((FALLBACK, SAFE_STATE, 1), (SAFE_STATE, SAFE_STATE, PERIOD_NS)),
    ],
)
def test_how_soon_a_change_is_reported(
    sent: SafetyState, state: SafetyState, after_ns: int
) -> None:
    telling = PlantStatusReports(0)
    telling.on_report(sent, 0, 0)
    telling.on_state(state, 1)
    assert telling.deadline_ns == after_ns


@given(
    st.lists(
        st.tuples(st.integers(1, 400), st.sampled_from(list(SafetyState))),
        max_size=40,
        unique_by=lambda change: change[0],
    )
)
def test_whatever_happens_frames_are_few_and_the_last_state_is_reported(
    states: list[tuple[int, SafetyState]],
) -> None:
    in_order = sorted((at_ms * MS_NS, state) for at_ms, state in states)
    sent = drive(in_order, 600 * MS_NS)
    assert {step * PERIOD_NS for step in range(6)} <= {at for at, _ in sent}
    # In any interval: the return, three that get worse step by step, and a cycle.
    for begin_ns, _ in sent:
        assert sum(begin_ns <= at < begin_ns + INTERVAL_NS for at, _ in sent) <= 5
    last = in_order[-1][1] if in_order else NORMAL
    assert sent[-1][1] is (NORMAL if last is LIMITING else last)
