"""Figures 7 to 12: what their functions yield, and the numbers behind the verdicts."""

import math
from functools import cache

import numpy as np
import pytest

from steer_by_wire.closed_loop.reports.plot_style import plot_style
from steer_by_wire.tools.paper.corners import CORNERS, published_law
from steer_by_wire.tools.paper.figures.frequency_figures import (
    corner_responses,
    figure_10,
    figure_11,
    spread,
)
from steer_by_wire.tools.paper.figures.parameter_space_figures import figure_7, figure_8
from steer_by_wire.tools.paper.figures.small_gain_figures import (
    figure_9,
    figure_12,
    first_intersection_rad_s,
    network_verdict,
)
from steer_by_wire.tools.paper.result import Reproduction, Verdict
from tests.support.suite.curves import alike_without_colour

FIGURES = {
    "figure_07": figure_7,
    "figure_08": figure_8,
    "figure_09": figure_9,
    "figure_10": figure_10,
    "figure_11": figure_11,
    "figure_12": figure_12,
}


@cache
def drawn(key: str) -> Reproduction:
    with plot_style():
        return FIGURES[key]()


@pytest.mark.parametrize("key", FIGURES)
def test_a_figure_is_complete_and_says_what_was_corrected(key: str) -> None:
    reproduction = drawn(key)
    assert reproduction.key == key
    assert reproduction.verdict is Verdict.WITH_CORRECTION
    assert reproduction.why
    for picture in reproduction.pictures:
        assert picture.name.startswith(key)
        assert not alike_without_colour(picture.figure)
        for axes in picture.figure.axes:
            assert axes.get_ylabel()
            assert all(np.all(np.isfinite(line.get_xydata())) for line in axes.lines)
        assert picture.figure.axes[-1].get_xlabel()


@pytest.mark.parametrize(
    ("key", "agree"),
    [
        ("figure_07", [True, True, True, None]),
        ("figure_08", [True]),
        ("figure_09", [True]),
        ("figure_10", []),
        ("figure_11", [True, True]),
        ("figure_12", [False, False, False, True, True]),  # with an ideal derivative, and filtered
    ],
)
def test_the_comparisons_of_a_figure_agree_as_its_verdict_says(
    key: str, agree: list[bool | None]
) -> None:
    assert [comparison.agrees for comparison in drawn(key).comparisons] == agree


def test_figures_7_to_9_say_the_values_behind_their_verdicts() -> None:
    reproduced = {c.quantity: c.reproduced for c in drawn("figure_07").comparisons}
    assert reproduced["their modulus"] == "0.585 rad/s"
    (axes,) = drawn("figure_09").pictures[0].figure.axes
    *inverse_db, q_db = (line.get_ydata() for line in axes.lines)
    assert len(inverse_db) == len(CORNERS)
    assert all(np.all(q_db < one_db) for one_db in inverse_db)
    assert drawn("figure_09").comparisons[0].reproduced == "a 4.4, b 4.4, c 13.4, d 13.8 dB"


def test_without_observer_the_vehicle_spreads_as_the_square_of_the_speed_at_rest() -> None:
    """(7/4)², less what understeer takes: V²/(l_f + l_r + K V²)."""
    assert 3.0 < spread(corner_responses("pd").regulated)[0] < (7.0 / 4.0) ** 2


@pytest.mark.parametrize("key", ["figure_10", "figure_11"])
def test_the_closed_loop_is_1_where_the_frequency_is_small(key: str) -> None:
    closed_loop, _ = drawn(key).pictures[0].figure.axes
    assert abs(closed_loop.lines[0].get_ydata()[0]) < 0.01


def test_the_curves_of_figure_12_first_meet_beyond_100_rad_s() -> None:
    ideal = published_law("pd_cdob")
    assert 105.0 < first_intersection_rad_s(ideal) < 106.0
    filtered = published_law("pd_cdob", "pd.derivative_filter_rad_s=20")
    assert math.isinf(first_intersection_rad_s(filtered))


def test_condition_and_roots_at_80_ms_are_these() -> None:
    ideal = network_verdict(published_law("pd_cdob"))
    assert 1.32 < ideal.ratio < 1.33
    assert 195.0 < ideal.omega_rad_s < 197.0
    assert (ideal.outside, ideal.at_one) == (6, 2)
    filtered = network_verdict(published_law("pd_cdob", "pd.derivative_filter_rad_s=20"))
    assert 0.59 < filtered.ratio < 0.60
    assert (filtered.outside, filtered.at_one) == (0, 2)
