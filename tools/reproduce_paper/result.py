"""What the reproduction of one figure or table yields; pictures, data, and a verdict."""

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray


class Verdict(StrEnum):
    """How the paper's statement compares with the result."""

    REPRODUCED = "reproduced"
    WITH_CORRECTION = "reproduced with the stated correction"
    NOT_REPRODUCIBLE = "not reproducible from the text"
    BEYOND = "beyond the paper"
    """The paper has no such figure or table: there is nothing to reproduce."""


class Picture(NamedTuple):
    """One picture and the data drawn in it.

    ``name``     of its files, without suffix: figure_09, figure_09_with_delay
    ``columns``  one table, all of one length: a header with the unit in the name, and numbers
    """

    name: str
    figure: Figure
    columns: Mapping[str, NDArray[np.float64]]


class Comparison(NamedTuple):
    """One figure of the paper beside ours, as text with units.

    ``published``   what the paper prints, or states in words; "" where it states nothing
    ``reproduced``  what was computed
    ``agrees``      None where there is nothing to agree with
    """

    quantity: str
    published: str
    reproduced: str
    agrees: bool | None


class Reproduction(NamedTuple):
    """One figure or table of the paper.

    ``key``      figure_09 or table_2
    ``caption``  the paper's parameters and ours
    ``why``      the reasons for the verdict, with the correction spelt out
    """

    key: str
    title: str
    caption: str
    pictures: tuple[Picture, ...]
    comparisons: tuple[Comparison, ...]
    verdict: Verdict
    why: str
