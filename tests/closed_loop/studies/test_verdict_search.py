"""The verdict on runs agrees with the linear analysis: a sample of ``verdict_search``."""

import pytest

from steer_by_wire.plant_emulator.evaluation.run_verdict import Verdict
from tests.closed_loop.studies.verdict_search import (
    BAND_1_S,
    Asked,
    asked_of,
    drawn_loop,
    summary,
    wrong_of,
)

SEED = 20
LOOPS = 6


@pytest.mark.parametrize("number", range(LOOPS))
def test_a_drawn_loop_holds_below_its_boundary_and_not_above(number: int) -> None:
    asked = list(asked_of(SEED, number))
    assert {one.decay_1_s > 0.0 for one in asked} == {True, False}
    assert wrong_of(asked) == []


def test_a_draw_is_repeated_by_its_seed_and_number() -> None:
    first, again, other = (drawn_loop(SEED, number) for number in (0, 0, 1))
    assert first == again != other


def test_a_wrong_verdict_counts_outside_what_it_cannot_tell() -> None:
    right = Asked(1, "practical_pd", "own", 0.0, 0.4, 2.0 * BAND_1_S, False, Verdict.HOLDS, ())
    wrong = right._replace(verdict=Verdict.LIMIT_CYCLE)
    missed = right._replace(decay_1_s=-2.0 * BAND_1_S)
    asked = [
        *(right, wrong, missed),
        wrong._replace(decay_1_s=0.5 * BAND_1_S),
        wrong._replace(is_sparse=True),
    ]
    assert wrong_of(asked) == [wrong, missed]
    noisy = right._replace(noise_m=0.02)
    asked += [noisy._replace(verdict=Verdict.OFF_PATH), noisy._replace(verdict=Verdict.UNSTABLE)]
    rows = [line for line in summary(asked) if line.lstrip().startswith("0.05 to 0.1")]
    assert [row.split()[-3:] for row in rows] == [["3", "1", "1"], ["0"] * 3, ["2", "0", "1"]]
