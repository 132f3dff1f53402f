"""How many corrupted frames may pass the CRC before a campaign calls it too many."""

import math

import pytest

from steer_by_wire.tools.faults.campaign.acceptance import RESIDUAL, exceeds


def test_one_frame_in_65536_may_pass() -> None:
    assert exceeds(2, 100)
    assert exceeds(60, 65536 * 30)
    assert not exceeds(0, 0)


@pytest.mark.parametrize("corrupted", [2_000_000, 50_000_000, 100_000_000])
def test_as_many_as_expected_are_not_too_many(corrupted: int) -> None:
    """Beyond 5e7 frames e to the minus expected is no number above 0 any more."""
    expected = corrupted * RESIDUAL
    assert not exceeds(round(expected), corrupted)
    assert exceeds(round(expected + 5.0 * math.sqrt(expected)), corrupted)
