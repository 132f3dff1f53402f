"""One line for each law, in every picture."""

import numpy as np

from steer_by_wire.closed_loop.reports.law_colours import LAW_LINES, law_lines
from steer_by_wire.closed_loop.reports.plot_style import law_styles
from steer_by_wire.controller.laws import LAWS
from steer_by_wire.tools.paper.delay_runs import CDOB, DDOB, PD, Compared, Variant
from steer_by_wire.tools.paper.figures.delay_figures import panels
from steer_by_wire.tools.paper.simulation import STEER, History


def test_every_shipped_law_has_a_line_of_its_own() -> None:
    assert set(LAW_LINES) == set(LAWS)
    assert len({line.colour for line in LAW_LINES.values()}) == len(LAW_LINES)
    assert len({line.dash for line in LAW_LINES.values()}) == len(LAW_LINES)


def test_no_two_curves_of_a_picture_look_alike() -> None:
    lines = law_lines(["pd", "own", "pd", "other", "pd", "pid", "own"])
    assert len(set(lines)) == len(lines)
    assert {line.colour for line in lines[::2][:3]} == {LAW_LINES["pd"].colour}


def test_the_papers_laws_look_as_in_all_pictures() -> None:
    run = History(*(np.arange(2.0) for _ in History._fields))
    variant = Variant("three", (PD, CDOB, DDOB))
    compared = Compared(variant, {law.label: run for law in variant.laws})
    drawn = panels("name", [compared] * 2, STEER)
    shown = [line.get_color() for line in drawn.figure.axes[0].get_lines()[:3]]
    assert shown == [look["color"] for look in law_styles(["pd", "pd_cdob", "pd_ddob"])]
