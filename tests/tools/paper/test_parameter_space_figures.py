"""Figures 7 and 8 of the paper: what they say comes out of the computation."""

from steer_by_wire.closed_loop.reports.plot_style import plot_style
from steer_by_wire.tools.paper.figures.parameter_space_figures import figure_7, figure_8
from steer_by_wire.tools.paper.result import Reproduction, Verdict
from tests.support.suite.curves import alike_without_colour


def reproduced(reproduction: Reproduction) -> dict[str, str]:
    for picture in reproduction.pictures:
        assert not alike_without_colour(picture.figure)
    return {c.quantity: c.reproduced for c in reproduction.comparisons}


def test_figure_7_shows_the_published_roots_within_every_bound() -> None:
    with plot_style():
        reproduction = figure_7()
    found = reproduced(reproduction)
    assert found["their modulus"] == "0.585 rad/s"
    assert [c.agrees for c in reproduction.comparisons].count(True) == 3
    assert False not in [c.agrees for c in reproduction.comparisons]
    assert reproduction.verdict is Verdict.WITH_CORRECTION


def test_figure_8_shows_the_published_gains_inside() -> None:
    with plot_style():
        reproduction = figure_8()
    found = reproduced(reproduction)
    assert found["published gains"] == "inside"
    assert reproduction.verdict is Verdict.WITH_CORRECTION
