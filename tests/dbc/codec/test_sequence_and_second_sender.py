"""Which counters a receiver believes, and that it follows nobody who forges them."""

from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.codec import sequence_and_second_sender as sequence
from steer_by_wire.dbc.codec.sequence_and_second_sender import (
    CAUTION_NS,
    SequenceCheck,
    SequenceResult,
    SequenceRule,
)
from steer_by_wire.plant_emulator.network.settings import Order
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from tests.support.attacks.forged_counters import (
    ALONE,
    PERIOD_NS,
    Absence,
    Shot,
    followed_after,
    hear,
)
from tests.support.attacks.one_forged_frame import drawn, longest_without_a_true_one_ns
from tests.support.frames.counter_rules import checking

ACCEPTED = SequenceResult.ACCEPTED
COMMANDS = PlantSettings().counters
MEASUREMENTS = controller_preset("practical_pd_ddob").counters
RULES = {"commands": COMMANDS, "measurements": MEASUREMENTS}


@given(
    st.lists(st.tuples(st.integers(0, 30), st.integers(0, 2)), max_size=200), st.integers(1, 127)
)
def test_an_older_frame_is_never_accepted_however_frames_are_delayed_lost_or_doubled(
    frames: list[tuple[int, int]], step_max: int
) -> None:
    """Each frame is (places it falls back, copies); no run of refusals is long enough."""
    arrivals = [
        (number + delay, number)
        for number, (delay, copies) in enumerate(frames)
        for _ in range(copies)
    ]
    sequence = checking(step_max, len(arrivals) + 1)
    accepted = [n for _, n in sorted(arrivals) if sequence.check(n % 256) is ACCEPTED]
    assert accepted == sorted(set(accepted))
    if accepted:
        assert sequence.lost == accepted[-1] - accepted[0] + 1 - len(accepted)


# Two senders

SOON = 100_000
"""A forged frame directly behind a true one [ns]."""
BURST = [Shot(SOON, 1 + step) for step in range(16)]
FOUND: dict[str, tuple[list[list[Shot]], bool]] = {
    "behind every second true frame": ([[Shot(SOON, 1)], []], True),
    "behind every third": ([[Shot(SOON, 1)], [], []], True),
    "behind four of five": ([[Shot(SOON, 1)]] * 4 + [[]], True),
    "a burst": ([BURST], False),
    "a burst, and then one a period": ([BURST, *[[Shot(SOON, 16)]] * 199], False),
    "three ahead": ([[Shot(SOON, 3)]], True),
    "as far ahead as is believed": ([[Shot(SOON, 30)]], True),
    "just before the true one": ([[Shot(9_900_000, 1)]], True),
    "three behind, from where it was used": ([[Shot(SOON, -3)]], True),
    "a contradiction of long ago as a decoy": ([[Shot(10_000, 1), Shot(20_000, -60)]], True),
    "old counters in a row, below the true one": (
        [[Shot(SOON, 14), *(Shot(SOON, -16 + step) for step in range(8))], [Shot(SOON, 47)]],
        True,
    ),
    "late ones in a row, to have a forged one taken for true": (
        [[Shot(2_300_000, 31)], [], [Shot(SOON + 100_000 * n, 31 + n) for n in range(16)], []],
        True,
    ),
}
"""Strategies that were followed for longer by earlier rules, most of them found by the search."""


def check_forged(rule: SequenceRule, shots: list[list[Shot]], first: int, *, repeats: bool) -> None:
    """No forged frame is in use for longer than until a true one must have come; then none is."""
    heard = hear(rule, shots, repeats=repeats, first=first)
    onset_ns = ALONE * PERIOD_NS
    until_ns = onset_ns + 2 * (rule.lead_ns + PERIOD_NS) + shots_end_ns(shots)
    assert heard.forged_total_ns <= rule.lead_ns + PERIOD_NS
    assert all(end_ns <= until_ns for _, end_ns in heard.forged_ns)


def shots_end_ns(shots: list[list[Shot]]) -> int:
    """When the first forged frame may come at the latest, after the onset."""
    return len(shots) * PERIOD_NS


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
@pytest.mark.parametrize(("shots", "repeats"), FOUND.values(), ids=FOUND)
def test_no_strategy_found_so_far_is_followed(
    rule: SequenceRule, shots: list[list[Shot]], repeats: bool
) -> None:
    for first in (0, 100, 250):
        check_forged(rule, shots, first, repeats=repeats)


SHOTS = st.builds(
    Shot,
    st.sampled_from([10_000, SOON, 5_000_000, 9_900_000]) | st.integers(0, 30_000_000),
    st.sampled_from([1, 2, 3, 5, 16, 30, 31, 0, -1, -3, -60]) | st.integers(-127, 128),
)
STRATEGIES = st.lists(st.lists(SHOTS, max_size=6), min_size=1, max_size=12)


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
@given(shots=STRATEGIES, repeats=st.booleans(), first=st.integers(0, 255))
def test_a_search_finds_no_strategy_that_is_followed(
    rule: SequenceRule, shots: list[list[Shot]], repeats: bool, first: int
) -> None:
    check_forged(rule, shots, first, repeats=repeats)


TAKEN_OVER: dict[str, tuple[list[list[Shot]], Absence, int]] = {
    "far behind after an outage": ([[Shot(14_527_990, -124)]], Absence(150, 188, 0), 161),
    "far behind after a restart": ([[Shot(SOON, -104)]], Absence(150, 258, 184), 172),
    "beside it after a restart": ([[Shot(9_900_000, 3)]], Absence(150, 240, 18), 251),
    "just ahead of it after a restart": ([[Shot(9_900_000, 5)]], Absence(150, 169, 210), 248),
    "sparse, behind a true sender that is too far ahead": (
        [[], [], [], [], [Shot(10_000, 1), Shot(0, -5)], *[[]] * 6, [Shot(10_000, 1)]],
        Absence(0, 20, 2),
        0,
    ),
    "leaps that wrap at once": (
        [[], [Shot(10_000, -3), Shot(10_000, 30), Shot(10_000, -99), Shot(10_000, -1)]],
        Absence(0, 20, 0),
        0,
    ),
    "just behind it from before its start": ([[Shot(9_900_000, -1)]], Absence(0, 104, 241), 223),
    "one lost frame": ([[Shot(5_000_000, 24)]], Absence(150, 151, 0), 128),
    "before the true sender begins": ([[Shot(SOON, -1)]], Absence(0, 21, 77), 79),
    "a stream that others interrupt": (
        [[Shot(9_900_000, 99), Shot(5_000_000, 16), Shot(9_900_000, 3)]],
        Absence(150, 184, 0),
        234,
    ),
    "far ahead of a true sender that is late in what he has skipped": (
        [[Shot(12_230_708, -77), Shot(9_900_000, 3)]],
        Absence(0, 108, 210),
        223,
    ),
    "leaps that shorten the measured period": (
        [
            [],
            [Shot(25_115_020, 31), Shot(28_999_100, 60), Shot(SOON, 5)],
            [Shot(5_000_000, -3), Shot(10_000, -122)],
            [],
            [Shot(9_900_000, -3)],
        ],
        Absence(150, 169, 0),
        224,
    ),
}
"""Strategies that were followed for ever by earlier rules, found by the search."""
ABSENCES = st.one_of(
    st.builds(Absence, st.just(0), st.integers(20, 200), st.integers(0, 255)),
    st.builds(Absence, st.just(150), st.integers(151, 300), st.integers(0, 255) | st.just(0)),
)


def followed_max(rule: SequenceRule) -> int:
    """Until no true frame is late enough for the network to explain it, and two more."""
    return 2 + max(rule.lead_ns, rule.resync_ns) // PERIOD_NS


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
@pytest.mark.parametrize(("shots", "absence", "first"), TAKEN_OVER.values(), ids=TAKEN_OVER)
def test_who_took_over_from_an_absent_sender_is_not_followed_beside_it(
    rule: SequenceRule, shots: list[list[Shot]], absence: Absence, first: int
) -> None:
    assert followed_after(rule, shots, absence, first=first) <= followed_max(rule)


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
@given(shots=STRATEGIES, absence=ABSENCES, first=st.integers(0, 255))
def test_a_search_finds_nobody_who_takes_over_for_longer_than_the_absence(
    rule: SequenceRule, shots: list[list[Shot]], absence: Absence, first: int
) -> None:
    assert followed_after(rule, shots, absence, first=first) <= followed_max(rule)


@pytest.mark.parametrize(("wait_cycles", "is_followed"), [(0.0, True), (0.5, True), (1.5, False)])
def test_the_wait_is_one_that_no_strategy_outlasts(
    wait_cycles: float, is_followed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sequence, "WAIT_CYCLES", wait_cycles)
    shots = [[Shot(SOON, 1), Shot(6_000_000, 2)], []]
    heard = hear(COMMANDS, shots, repeats=True)
    assert (heard.forged_total_ns > COMMANDS.lead_ns + PERIOD_NS) == is_followed


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
@given(ahead=st.integers(-127, 128), after_ns=st.integers(0, 10_000_000), first=st.integers(0, 255))
@example(ahead=31, after_ns=0, first=0)
@example(ahead=0, after_ns=0, first=106)
def test_one_forged_frame_delays_the_true_ones_by_two_periods_for_ten_seconds(
    rule: SequenceRule, ahead: int, after_ns: int, first: int
) -> None:
    frames = 1100
    heard = hear(rule, [[Shot(after_ns, ahead)]], repeats=False, frames=frames, first=first)
    used_ns = [e.time_ns for e in heard.events if e.result in sequence.CHANGING]
    gaps_ns = [after - before for before, after in pairwise(used_ns)]
    # A forged frame far ahead is taken for the newest, until a run of true ones contradicts it.
    assert max(gaps_ns) <= (rule.resync_run + 3) * PERIOD_NS < rule.resync_ns
    assert heard.check.content == (False, ALONE + frames - 1)
    assert heard.events[-1].time_ns - ALONE * PERIOD_NS > CAUTION_NS


ONE_FORGED_NS_MAX = NS_PER_S
"""Behind jitter, a frame that waits is confirmed later."""


@pytest.mark.parametrize(
    ("rule", "spread_ns_max", "orders"),
    [
        (COMMANDS, COMMANDS.lead_ns, [Order.IN_ORDER]),
        (MEASUREMENTS, 60 * NS_PER_MS, [Order.NEWEST_WINS, Order.IN_ORDER]),
    ],
    ids=RULES,
)
@given(seed=st.integers(0, 2**32))
@example(seed=10_000_620)  # soon after the start, at 1.6 ms
@example(seed=10_001_733)  # at 1.1 ms
def test_one_forged_frame_locks_the_true_ones_out_at_no_period_and_behind_little_jitter(
    rule: SequenceRule, spread_ns_max: int, orders: list[Order], seed: int
) -> None:
    stream = drawn(seed, spread_ns_max, orders)
    assert longest_without_a_true_one_ns(stream, rule) <= ONE_FORGED_NS_MAX


def test_a_sender_that_restarts_anywhere_is_followed_after_its_silence_and_is_no_second_one() -> (
    None
):
    for restart in range(256):
        check = SequenceCheck(COMMANDS, PERIOD_NS)
        numbers = [*range(300), *range(restart, restart + 40)]
        results = [
            check.check(number % 256, step * PERIOD_NS, (step >= 300, number))
            for step, number in enumerate(numbers)
        ]
        refused = [step for step, one in enumerate(results) if one not in sequence.CHANGING]
        last = max(refused, default=0)
        # A contradiction, of a counter from before the restart, begins the silence anew.
        assert last - 300 <= 2 * COMMANDS.resync_ns // PERIOD_NS + 4, restart
        assert check.second_sender_ns is None


def test_a_network_that_doubles_and_delays_frames_contradicts_nothing() -> None:
    check = SequenceCheck(MEASUREMENTS, PERIOD_NS)
    for number in range(600):
        for late in (0, 1, 7, 40):
            if number >= late and (late == 0 or number % 3 == 0):
                check.check((number - late) % 256, number * PERIOD_NS, number - late)
    assert check.counter == 599 % 256
    assert check.second_sender_ns is None


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("periods", range(1, COMMANDS.resync_run + 1))
def test_late_and_new_frames_in_turn_at_the_end_of_a_spike_of_latency_contradict_nothing(
    periods: int, order: int
) -> None:
    for first in range(0, 256, 5):
        check = SequenceCheck(COMMANDS, PERIOD_NS)
        arrivals = sorted((n + periods * (n < 100), order * n, n) for n in range(150))
        in_use = []
        for place, _, number in arrivals:
            check.check((first + number) % 256, place * PERIOD_NS, number)
            in_use.append(check.content)
        assert in_use == [max(n for _, _, n in arrivals[: one + 1]) for one in range(150)]


def test_after_an_outage_in_which_the_counters_wrapped_nothing_is_contradicted() -> None:
    for missing in range(1, 600):
        check = SequenceCheck(MEASUREMENTS, PERIOD_NS)
        numbers = [*range(100), *range(100 + missing, 140 + missing)]
        results = [check.check(one % 256, one * PERIOD_NS, one) for one in numbers]
        assert SequenceResult.CONTRADICTED not in results
        assert SequenceResult.TAKEN_BACK not in results
        assert results[-1] is ACCEPTED


def test_a_receiver_that_gives_no_content_asks_for_no_contradictions() -> None:
    check = SequenceCheck(COMMANDS, PERIOD_NS)
    for number in (*range(50), *range(45, 50), *range(50, 60)):
        check.check(number, number * NS_PER_MS)
    assert check.counter == 59


def test_frames_that_five_others_overtake_again_and_again_are_no_second_sender() -> None:
    check = SequenceCheck(COMMANDS, PERIOD_NS)
    sent = sorted((number + 5.5 * (number % 12 == 0), number) for number in range(600))
    for place, number in sent:
        check.check(number % 256, round(place * PERIOD_NS), number)
    assert check.second_sender_ns is None
    assert check.counter == 599 % 256
