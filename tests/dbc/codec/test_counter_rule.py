"""The counter rule: the step bound, restarts, and the measured period."""

from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.codec.counter_rule import (
    CounterResult,
    CounterRule,
    CounterState,
    counter_step,
    start_counters,
)

MS = 1_000_000
PERIOD_NS = 10 * MS
RULE = CounterRule(lead_ns=40 * MS, resync_run=3, resync_ns=100 * MS, period_ns=PERIOD_NS)
ACCEPTED, REPEATED, OUT_OF_ORDER, TOO_FAR = CounterResult


def received(
    frames: list[tuple[int, int]], rule: CounterRule = RULE
) -> tuple[CounterState, list[CounterResult]]:
    """The state and the results after frames of (number, arrival [ns])."""
    state, results = start_counters(rule), []
    for number, now_ns in frames:
        state, result = counter_step(rule, state, number % 256, now_ns)
        results.append(result)
    return state, results


def test_time_and_the_lead_bound_a_step() -> None:
    for late_ns, step, expected in (
        (0, 5, ACCEPTED),
        (0, 6, TOO_FAR),
        (10 * MS - 1, 6, TOO_FAR),
        (10 * MS, 6, ACCEPTED),
        (5000 * MS, 127, ACCEPTED),
        (5000 * MS, 128, OUT_OF_ORDER),
        (5000 * MS, 255, OUT_OF_ORDER),
        (5000 * MS, 256, REPEATED),
    ):
        state, results = received([(250, 0), (250 + step, late_ns)])
        assert results == [ACCEPTED, expected], (late_ns, step)
        assert state.lost == (step - 1 if expected is ACCEPTED else 0)


def test_a_restart_takes_a_run_of_refused_frames_and_silence() -> None:
    start = [(0, 0), (1, 10 * MS)]
    run = [(200 + step, (20 + 10 * step) * MS) for step in range(12)]
    state, results = received(start + run)
    assert results[2:] == [OUT_OF_ORDER] * 9 + [ACCEPTED] * 3  # from 110 ms on: 100 after the last
    assert (state.restarts, state.lost) == (1, 0)
    # A gap within the run, and a frame of the old sequence, begin it again.
    _, results = received(
        [*start, (200, 90 * MS), (201, 100 * MS), (203, 110 * MS), (204, 120 * MS)]
    )
    assert results[2:] == [OUT_OF_ORDER] * 4
    _, results = received(start + [(200 + step, 500 * MS) for step in range(4)])
    assert results[2:] == [OUT_OF_ORDER] * 3 + [ACCEPTED]


def test_the_period_of_a_faster_sender_is_measured_at_each_wrap() -> None:
    fast = [(number, number * 2 * MS) for number in range(600)]
    state, results = received(fast)
    assert set(results) == {ACCEPTED}
    assert state.period_ns == 2 * MS
    mostly_lost = [(number, number * 2 * MS) for number in range(0, 600, 3)]
    assert received(mostly_lost)[0].period_ns == PERIOD_NS
    slow = [(number, number * 50 * MS) for number in range(600)]
    assert received(slow)[0].period_ns == PERIOD_NS


@given(
    st.lists(
        st.tuples(st.integers(0, 100), st.booleans(), st.booleans()), min_size=1, max_size=300
    ),
    st.integers(0, 255),
)
def test_on_any_network_no_older_frame_is_accepted(
    fates: list[tuple[int, bool, bool]], first: int
) -> None:
    """Each frame is delayed by up to 100 periods, and may be lost or doubled."""
    rule = RULE._replace(lead_ns=1000 * MS, resync_ns=10**18)
    arrivals = []
    for number, (late, is_lost, is_doubled) in enumerate(fates):
        arrivals += [(number + late, number)] * (not is_lost)
        arrivals += [(number + late + 1, number)] * is_doubled
    arrivals.sort()
    _, results = received([(first + number, at * PERIOD_NS) for at, number in arrivals], rule)
    accepted = [
        number for (_, number), result in zip(arrivals, results, strict=True) if result is ACCEPTED
    ]
    newest = [max(number for _, number in arrivals[: end + 1]) for end in range(len(arrivals))]
    assert accepted == sorted(set(newest))
