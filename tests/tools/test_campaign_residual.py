"""How many corrupted frames may pass the CRC before a campaign calls it too many, or too few."""

import math

import pytest

from steer_by_wire.tools.faults.campaign.acceptance import (
    Residual,
    exceeds,
    falls_short,
    measure_residual,
    residual_finding,
)


def test_the_residual_probability_of_the_crc_is_what_it_should_be() -> None:
    measured = measure_residual(300_000)
    assert residual_finding(measured).holds, measured
    assert exceeds(2, 100)
    assert exceeds(60, 65536 * 30)
    assert falls_short(8, 65536 * 30)
    assert not exceeds(0, 0)
    assert not residual_finding(Residual(65536 * 30, 3)).holds


@pytest.mark.parametrize("corrupted", [2_000_000, 50_000_000, 100_000_000])
def test_as_many_as_expected_are_neither_too_many_nor_too_few(corrupted: int) -> None:
    """Beyond 5e7 frames e to the minus expected is no number above 0 any more."""
    expected = Residual(corrupted, 0).expected
    spread = math.sqrt(expected)
    assert residual_finding(Residual(corrupted, round(expected))).holds
    assert not residual_finding(Residual(corrupted, round(expected + 5.0 * spread))).holds
    assert not residual_finding(Residual(corrupted, round(expected - 5.0 * spread))).holds
