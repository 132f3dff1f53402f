"""Figures 2, 9, 10, 11 and 12: what their functions yield, and the numbers behind the verdicts."""

import math

import numpy as np

from steer_by_wire.closed_loop.reports.plot_style import plot_style
from steer_by_wire.tools.paper.corners import CORNERS, published_law
from steer_by_wire.tools.paper.figures.frequency_figures import (
    corner_spreads,
    figure_10,
    figure_11,
)
from steer_by_wire.tools.paper.figures.small_gain_figures import (
    DELAY_S,
    figure_9,
    figure_12,
    first_intersection_rad_s,
    network_verdict,
)
from steer_by_wire.tools.paper.result import Reproduction, Verdict
from tests.support.suite.curves import alike_without_colour


def check_form(reproduction: Reproduction, key: str) -> None:
    assert reproduction.key == key
    for picture in reproduction.pictures:
        assert picture.name.startswith(key)
        assert not alike_without_colour(picture.figure)
        for axes in picture.figure.axes:
            assert axes.get_ylabel()
            assert all(np.all(np.isfinite(line.get_xydata())) for line in axes.lines)
        assert picture.figure.axes[-1].get_xlabel()
    assert reproduction.why


def test_figure_9_meets_its_condition_at_every_vertex() -> None:
    with plot_style():
        reproduction = figure_9()
    check_form(reproduction, "figure_09")
    (axes,) = reproduction.pictures[0].figure.axes
    *inverse_db, q_db = (line.get_ydata() for line in axes.lines)
    assert len(inverse_db) == len(CORNERS)
    assert all(np.all(q_db < one_db) for one_db in inverse_db)
    (published,) = reproduction.comparisons
    assert published.agrees is True
    assert published.reproduced == "a 4.4, b 4.4, c 13.4, d 13.8 dB"


def test_without_observer_the_vehicle_spreads_as_the_square_of_the_speed_at_rest() -> None:
    """(7/4)², less what understeer takes: V²/(l_f + l_r + K V²)."""
    spread = corner_spreads("pd").regulated.spread[0]
    assert 3.0 < spread < (7.0 / 4.0) ** 2


def test_figures_10_and_11_agree_with_what_the_text_says_of_them() -> None:
    with plot_style():
        tenth, eleventh = figure_10(), figure_11()
    check_form(tenth, "figure_10")
    check_form(eleventh, "figure_11")
    assert [comparison.agrees for comparison in eleventh.comparisons] == [True, True]
    for figure in (tenth, eleventh):
        closed_loop, _ = figure.pictures[0].figure.axes
        assert abs(closed_loop.lines[0].get_ydata()[0]) < 0.01  # |y/r| is 1 where ω is small


def test_figure_12_holds_with_a_filtered_derivative_and_not_with_an_ideal_one() -> None:
    with plot_style():
        reproduction = figure_12()
    check_form(reproduction, "figure_12")
    assert reproduction.verdict is Verdict.WITH_CORRECTION
    verdicts = {comparison.quantity: comparison.agrees for comparison in reproduction.comparisons}
    ideal = [agrees for quantity, agrees in verdicts.items() if "ideal" in quantity]
    filtered = [
        agrees for quantity, agrees in verdicts.items() if quantity.endswith("N = 20 rad/s")
    ]
    assert ideal == [False, False, False]
    assert filtered == [True, True]


def test_the_curves_of_figure_12_first_meet_beyond_100_rad_s() -> None:
    ideal = published_law("pd_cdob")
    assert 105.0 < first_intersection_rad_s(ideal, DELAY_S) < 106.0
    filtered = published_law("pd_cdob", "pd.derivative_filter_rad_s=20")
    assert math.isinf(first_intersection_rad_s(filtered, DELAY_S))


def test_condition_and_roots_at_80_ms_are_these() -> None:
    ideal = network_verdict(published_law("pd_cdob"), DELAY_S)
    assert 1.32 < ideal.ratio < 1.33
    assert 195.0 < ideal.omega_rad_s < 197.0
    assert (ideal.outside, ideal.at_one) == (6, 2)
    filtered = network_verdict(published_law("pd_cdob", "pd.derivative_filter_rad_s=20"), DELAY_S)
    assert 0.59 < filtered.ratio < 0.60
    assert (filtered.outside, filtered.at_one) == (0, 2)
