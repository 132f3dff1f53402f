"""Colour and dash of every law: the same in pictures, reports, the paper's figures and the cockpit.

The colours are those of Okabe and Ito, distinct with any colour vision. Dashes are lengths of line
and gap in widths of the line; none is a solid line.
"""

from collections.abc import Iterable
from itertools import cycle
from typing import NamedTuple

COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_GREY = "#808080"


class LawLine(NamedTuple):
    """How the curve of a law is drawn."""

    colour: str
    dash: tuple[float, ...]


LAW_LINES = {
    "pd": LawLine(COLOURS[6], ()),
    "pd_cdob": LawLine(COLOURS[0], (3.7, 1.6)),
    "pd_dob": LawLine(COLOURS[4], (4, 1, 1, 1, 1, 1)),
    "pd_ddob": LawLine(COLOURS[3], (6.4, 1.6, 1, 1.6)),
    "pid": LawLine(COLOURS[1], (7, 2)),
    "predictor": LawLine(COLOURS[2], (3, 1, 1, 1)),
    "packet": LawLine(COLOURS[5], (1, 1)),
    "mpc": LawLine("#882255", (9, 1, 3, 1)),
    "smith": LawLine(_GREY, (2, 3)),
}
"""By the law's name in the settings."""
_SPARE = ((5, 1), (1, 3), (8, 2, 2, 2), (3, 3), (6, 1, 1, 1, 1, 1))
"""Dashes of further curves of a law, and of laws of others."""


def law_lines(laws: Iterable[str]) -> list[LawLine]:
    """Return the lines of the curves of a picture, each of a law; of two curves none is equal."""
    spare, lines, drawn = cycle(_SPARE), list[LawLine](), set[str]()
    for law in laws:
        line = LAW_LINES.get(law)
        if line is None or law in drawn:
            line = LawLine(line.colour if line else _GREY, next(spare))
        lines.append(line)
        drawn.add(law)
    return lines
