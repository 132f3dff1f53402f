"""The mode table, transition by transition."""

from itertools import pairwise, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.controller.node.modes import (
    TRANSITIONS,
    Evidence,
    ModeState,
    Supervision,
    Supervisor,
    mode_step,
)
from steer_by_wire.dbc.messages import Mode

MS_NS = 1_000_000
P = Supervision(measurement_timeout_ns=300 * MS_NS, hold_ns=500 * MS_NS, recovery_frames=5)
NOW_NS = 10_000 * MS_NS


def after(mode: Mode, evidence: Evidence, entered_ms_ago: int = 0) -> Mode:
    return mode_step(P, ModeState(mode, NOW_NS - entered_ms_ago * MS_NS), evidence, NOW_NS).mode


def measured(
    ms_ago: int,
    run: int = 1,
    *,
    law_failed: bool = False,
    own_fault: bool = False,
    goes_forward: bool = True,
) -> Evidence:
    return Evidence(NOW_NS - ms_ago * MS_NS, run, law_failed, own_fault, goes_forward)


NOTHING = Evidence(None, 0)

# Mode, evidence, how long the mode has lasted [ms], the mode that follows: each row of the
# table, met exactly on its threshold.
TAKEN = [
    (Mode.WAITING, measured(300), 0, Mode.ACTIVE),
    (Mode.ACTIVE, measured(0, law_failed=True, own_fault=True), 0, Mode.SAFE_STOP),
    (Mode.ACTIVE, measured(0, law_failed=True), 0, Mode.HOLDING),
    (Mode.ACTIVE, measured(301), 0, Mode.HOLDING),
    (Mode.ACTIVE, measured(0, goes_forward=False), 0, Mode.HOLDING),
    (Mode.HOLDING, measured(300, run=5, own_fault=True), 0, Mode.SAFE_STOP),
    (Mode.HOLDING, measured(300, run=5), 0, Mode.ACTIVE),
    (Mode.HOLDING, measured(301), 500, Mode.SAFE_STOP),
    (Mode.SAFE_STOP, measured(300, run=5), 0, Mode.ACTIVE),
]

# The same, just short of the threshold.
NOT_TAKEN = [
    (Mode.WAITING, NOTHING, 10_000),
    (Mode.WAITING, measured(301), 10_000),
    (Mode.ACTIVE, measured(300), 10_000),
    (Mode.HOLDING, measured(0, run=4), 499),
    (Mode.HOLDING, measured(301, run=5), 499),
    (Mode.SAFE_STOP, measured(0, run=4), 10_000),
    (Mode.SAFE_STOP, measured(301, run=5), 10_000),
    (Mode.SAFE_STOP, measured(0, run=5, own_fault=True), 10_000),
    (Mode.HOLDING, measured(0, run=5, goes_forward=False), 499),
    (Mode.SAFE_STOP, measured(0, run=5, goes_forward=False), 10_000),
]


@pytest.mark.parametrize(("mode", "evidence", "lasted_ms", "following"), TAKEN)
def test_a_transition_is_taken_on_its_threshold(
    mode: Mode, evidence: Evidence, lasted_ms: int, following: Mode
) -> None:
    assert after(mode, evidence, lasted_ms) is following


@pytest.mark.parametrize(("mode", "evidence", "lasted_ms"), NOT_TAKEN)
def test_a_mode_stays_short_of_the_threshold(
    mode: Mode, evidence: Evidence, lasted_ms: int
) -> None:
    assert after(mode, evidence, lasted_ms) is mode


def test_every_row_of_the_table_is_tested_above() -> None:
    rows = [(mode, following) for mode, rows in TRANSITIONS.items() for _, following in rows]
    assert sorted(rows) == sorted((mode, following) for mode, _, _, following in TAKEN)
    assert set(TRANSITIONS) == set(Mode)


def test_recovery_goes_before_the_end_of_the_hold() -> None:
    assert after(Mode.HOLDING, measured(0, run=5), entered_ms_ago=500) is Mode.ACTIVE


def test_a_transition_notes_its_time_and_staying_does_not() -> None:
    state = ModeState(Mode.WAITING, 0)
    assert mode_step(P, state, NOTHING, NOW_NS) == state
    assert mode_step(P, state, measured(0), NOW_NS) == ModeState(Mode.ACTIVE, NOW_NS)


EVIDENCE = st.builds(
    Evidence, st.none() | st.integers(0, NOW_NS), st.integers(0, 10), st.booleans(), st.booleans()
)


@given(st.lists(EVIDENCE, max_size=50))
def test_only_steps_of_the_table_are_ever_taken(steps: list[Evidence]) -> None:
    states = [ModeState(Mode.WAITING, 0)]
    for index, evidence in enumerate(steps):
        states.append(mode_step(P, states[-1], evidence, NOW_NS + index * 100 * MS_NS))
    for before, state in pairwise(states):
        assert state == before or state.mode in {mode for _, mode in TRANSITIONS[before.mode]}
    if all(evidence.arrival_ns is None for evidence in steps):
        assert states[-1].mode is Mode.WAITING


@given(st.data())
def test_the_short_way_of_a_usual_tick_is_that_no_row_of_the_table_is_true(
    data: st.DataObject,
) -> None:
    """A fault or a guard that only one of the two knew would be acted on late, or never."""
    near_ns = st.integers(P.measurement_timeout_ns - 2, P.measurement_timeout_ns + 2)
    arrival_ns = data.draw(st.none() | near_ns.map(lambda age_ns: NOW_NS - age_ns))
    supervisor = Supervisor(P, 0)
    state = ModeState(Mode.WAITING, 0)
    if data.draw(st.booleans()):
        supervisor.move_on(NOW_NS, NOW_NS)
        state = ModeState(Mode.ACTIVE, NOW_NS)
    has_fault, goes_forward = data.draw(st.booleans()), data.draw(st.booleans())
    if has_fault:
        supervisor.on_own_fault()
    supervisor.goes_forward = goes_forward
    evidence = Evidence(arrival_ns, 0, False, has_fault, goes_forward)
    is_usual = state.mode is Mode.ACTIVE and mode_step(P, state, evidence, NOW_NS) == state
    assert supervisor.stays_active(arrival_ns, NOW_NS) is is_usual


def test_recovery_comes_as_soon_as_so_many_more_measurements_were_good_than_damaged() -> None:
    """Every order of eight frames: good less damaged ones, counted from any of them on."""
    supervision = P._replace(recovery_frames=3)
    for order in product((1, -1), repeat=8):
        supervisor = Supervisor(supervision, 0)
        supervisor.on_measurement(None, 0)
        supervisor.move_on(0, 0)
        now_ns = before_ns = 1000 * MS_NS
        supervisor.move_on(0, now_ns)
        most = 0
        for gain in order:
            now_ns += 10 * MS_NS
            most = max(most + gain, 0)
            if gain < 0:
                supervisor.on_rejection()
            else:
                supervisor.on_measurement(before_ns, now_ns)
                before_ns = now_ns
            supervisor.move_on(before_ns, now_ns)
            assert (supervisor.mode is Mode.ACTIVE) == (most >= 3)
            if supervisor.mode is Mode.ACTIVE:
                break
