"""A slice of what ``python -m tests.support.wire.errored_frames 1000000`` sends."""

from collections import Counter

import pytest

from steer_by_wire.runtime.bus_model.bus_model import Delivery
from steer_by_wire.runtime.frame import Frame
from tests.support.wire.errored_frames import SCENARIOS, Receipts, send


def test_errors_lose_repeat_and_reorder_only_what_the_standard_permits() -> None:
    total: Counter[str] = Counter()
    for number, scenario in enumerate(SCENARIOS):
        total += send(scenario, 800, 100 + number)
    # Each of the cases that are permitted has come about.
    assert min(total[what] for what in ("twice", "omitted", "lost", "bus_offs", "passive")) > 10


def receipts_of(*order: int) -> Receipts:
    frames, receipts = [Frame(0x100, b"same") for _ in range(3)], Receipts(is_fifo=False)
    for frame in frames:
        receipts.submitted(frame)
    for end_ns, index in enumerate(order):
        receipts.take(Delivery(end_ns, 0, frames[index]), set())
    return receipts


def test_equal_frames_are_told_apart() -> None:
    assert (receipts_of(0, 1, 2).distinct, receipts_of(0, 1, 2).twice) == (3, 0)
    assert (receipts_of(0, 2).distinct, receipts_of(0, 2).omitted) == (2, 0)
    assert (receipts_of(0, 1, 1, 2).distinct, receipts_of(0, 1, 1, 2).twice) == (3, 1)
    with pytest.raises(AssertionError):
        receipts_of(0, 2, 1)
