"""Figures 7 and 8 of the paper, and beyond them: what they say comes out of the computation."""

import numpy as np
import pytest

from steer_by_wire.tools.paper.parameter_space_figures import figure_7, figure_8, figure_8_beyond
from steer_by_wire.tools.paper.result import Reproduction, Verdict


@pytest.fixture(scope="module")
def beyond() -> Reproduction:
    return figure_8_beyond()


def reproduced(reproduction: Reproduction) -> dict[str, str]:
    return {c.quantity: c.reproduced for c in reproduction.comparisons}


def test_figure_7_shows_the_published_roots_within_every_bound() -> None:
    reproduction = figure_7()
    found = reproduced(reproduction)
    assert found["dominant roots at the published gains"] == "-0.5501 ± 0.1982j rad/s"
    assert [c.agrees for c in reproduction.comparisons].count(True) == 3
    assert False not in [c.agrees for c in reproduction.comparisons]
    assert reproduction.verdict is Verdict.WITH_CORRECTION


def test_figure_8_shows_the_published_gains_inside() -> None:
    reproduction = figure_8()
    found = reproduced(reproduction)
    assert found["published gains"] == "inside"
    assert reproduction.verdict is Verdict.WITH_CORRECTION


def test_beyond_figure_8_every_corner_holds_and_a_delay_needs_a_filter(
    beyond: Reproduction,
) -> None:
    inside = {
        quantity.removeprefix("published gains: "): text.startswith("inside")
        for quantity, text in reproduced(beyond).items()
        if quantity.startswith("published gains: ")
    }
    assert inside == {
        "4 km/h, 1600 kg": True,
        "4 km/h, 5000 kg": True,
        "7 km/h, 1600 kg": True,
        "7 km/h, 5000 kg": True,
        "sampled, ideal derivative, 0 ms": True,
        "sampled, ideal derivative, 80 ms": False,
        "sampled, ideal derivative, 160 ms": False,
        "sampled, N = 20 rad/s, 0 ms": True,
        "sampled, N = 20 rad/s, 80 ms": False,
        "sampled, N = 20 rad/s, 160 ms": False,
        "sampled, N = 5 rad/s, 0 ms": True,
        "sampled, N = 5 rad/s, 80 ms": True,
        "sampled, N = 5 rad/s, 160 ms": False,
    }


def test_the_data_beside_a_picture_is_one_table(beyond: Reproduction) -> None:
    for reproduction in (figure_7(), figure_8(), beyond):
        for picture in reproduction.pictures:
            lengths = {len(column) for column in picture.columns.values()}
            assert len(lengths) == 1
            assert all(column.dtype == np.float64 for column in picture.columns.values())
