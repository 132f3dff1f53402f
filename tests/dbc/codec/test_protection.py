"""E2E profile 5 against a bit by bit CRC, and what the sequence check believes of a counter."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.codec.protection import (
    PERIOD_NS_MIN,
    SequenceCheck,
    SequenceResult,
    SequenceRule,
    id_mark,
    mark_in,
    protect,
)
from tests.support.counter_rules import checking

ACCEPTED = SequenceResult.ACCEPTED


def crc16_bit_by_bit(data: bytes) -> int:
    """CRC-16 as AUTOSAR names it: polynomial 0x1021, start 0xFFFF, highest bit first."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def test_the_reference_has_the_published_check_value() -> None:
    assert crc16_bit_by_bit(b"123456789") == 0x29B1


@given(st.binary(min_size=1, max_size=62), st.integers(0, 0xFFFF))
def test_the_crc_covers_what_follows_it_and_then_the_data_id(content: bytes, data_id: int) -> None:
    payload = bytearray(b"\xaa\x55" + content)
    protect(payload, data_id)
    crc = crc16_bit_by_bit(content + data_id.to_bytes(2, "little"))
    assert payload == crc.to_bytes(2, "little") + content
    assert mark_in(bytes(payload)) == id_mark(data_id) != id_mark(data_id ^ 1)


def judge(counters: list[int], step_max: int = 10, resync_run: int = 5) -> list[SequenceResult]:
    sequence = checking(step_max, resync_run)
    return [sequence.check(counter % 256) for counter in counters]


@pytest.mark.parametrize(
    ("second", "result"),
    [
        (200, SequenceResult.REPEATED),
        (201, ACCEPTED),
        (210, ACCEPTED),
        (211, SequenceResult.TOO_FAR),
        (200 + 127, SequenceResult.TOO_FAR),
        (200 + 128, SequenceResult.OUT_OF_ORDER),
        (199, SequenceResult.OUT_OF_ORDER),
    ],
)
def test_a_counter_is_judged_by_its_distance_from_the_newest(
    second: int, result: SequenceResult
) -> None:
    assert judge([200, second]) == [ACCEPTED, result]


@given(st.integers(0, 255), st.integers(1, 600))
def test_an_undisturbed_sender_is_always_accepted(first: int, frames: int) -> None:
    sequence = checking(1, 1)
    assert {sequence.check((first + index) % 256) for index in range(frames)} == {ACCEPTED}
    assert sequence.lost == 0


@given(st.integers(0, 255), st.lists(st.integers(1, 20), max_size=100))
def test_frames_that_do_not_come_are_counted_as_lost(first: int, steps: list[int]) -> None:
    sequence = checking(20, 5)
    number = first
    sequence.check(number)
    for step in steps:
        number += step
        assert sequence.check(number % 256) is ACCEPTED
    assert sequence.lost == sum(step - 1 for step in steps)


@given(
    st.lists(st.tuples(st.integers(0, 30), st.integers(0, 2)), max_size=200),
    st.integers(1, 127),
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


@given(
    st.lists(st.sampled_from([1, 1, 1, 0, 2, 12, 100, 128, 200, 255]), min_size=1, max_size=200),
    st.integers(1, 127),
    st.integers(1, 6),
)
def test_a_frame_is_accepted_only_as_slightly_newer_or_after_a_run_of_refusals(
    steps: list[int], step_max: int, resync_run: int
) -> None:
    counters = [sum(steps[: index + 1]) % 256 for index in range(len(steps))]
    results = judge(counters, step_max, resync_run)
    newest = None
    for index, (counter, result) in enumerate(zip(counters, results, strict=True)):
        run = range(max(index - resync_run, 0), index)
        run_of_refusals = len(run) == resync_run and all(
            results[i] is not ACCEPTED and (counters[i] + 1) % 256 == counters[i + 1] for i in run
        )
        slightly_newer = newest is None or 1 <= (counter - newest) % 256 <= step_max
        assert (result is ACCEPTED) == (slightly_newer or run_of_refusals)
        newest = counter if result is ACCEPTED else newest


@pytest.mark.parametrize("restart", [0, 90, 99, 150, 227, 228])
def test_a_restarted_sender_is_believed_after_the_run(restart: int) -> None:
    counters = [99, 100, *range(restart, restart + 10)]
    results = judge(counters)
    assert results[-4:] == [ACCEPTED] * 4
    if restart not in {90, 99}:  # 99 and 90 count up to 101, the next that is expected
        assert ACCEPTED not in results[2:7]


def test_a_resynchronisation_counts_nothing_as_lost() -> None:
    sequence = checking(10, 3)
    for counter in [50, 200, 201, 202, 203]:
        sequence.check(counter)
    assert sequence.check(204) is ACCEPTED
    assert sequence.lost == 0
    assert sequence.resynchronised == 1


def test_an_accepted_frame_ends_a_run_of_refusals() -> None:
    counters = [50, 200, 201, 202, 51, 203, 204, 205, 206]
    assert judge(counters, resync_run=3)[-4:] == [SequenceResult.OUT_OF_ORDER] * 3 + [ACCEPTED]


@pytest.mark.parametrize("values", [(-1, 1, 0), (0, 0, 0), (0, 1, -1)])
def test_a_rule_that_cannot_work_is_refused(values: tuple[int, int, int]) -> None:
    with pytest.raises(ValueError, match="allowed is"):
        SequenceCheck(SequenceRule(*values), PERIOD_NS_MIN)
