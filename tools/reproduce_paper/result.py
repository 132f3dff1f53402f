"""The reproduction of one figure or table: pictures, data, and a verdict."""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import NamedTuple

from matplotlib.figure import Figure

from ...runtime.array_types import FloatArray


class Verdict(StrEnum):
    """How the paper's statement compares with the result."""

    REPRODUCED = "reproduced"
    WITH_CORRECTION = "reproduced with the stated correction"
    ONE_READING = "reproduced in one reading of the text, with the stated correction"
    CLAIM_ONLY = "the claim holds, not all numbers do"
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
    columns: Mapping[str, FloatArray]


CLAIM, NUMBER = "claim", "number"
"""What a comparison may decide: a statement of the text, or a printed number."""


class Comparison(NamedTuple):
    """One figure of the paper beside ours, as text with units.

    ``published``   what the paper prints, or states in words; "" where it states nothing
    ``reproduced``  what was computed
    ``agrees``      None where there is nothing to agree with
    ``decides``     CLAIM or NUMBER where the verdict follows from it; "" where it does not
    ``reading``     of an ambiguous text, in which it decides
    """

    quantity: str
    published: str
    reproduced: str
    agrees: bool | None
    decides: str = ""
    reading: str = ""


def unpublished(quantity: str, reproduced: str) -> Comparison:
    """Return a figure of ours of which the paper states nothing."""
    return Comparison(quantity, "", reproduced, None)


def verdict_of(comparisons: Sequence[Comparison], *, is_corrected: bool) -> Verdict:
    """Return the verdict that follows from the comparisons that decide.

    ``is_corrected``  whether something printed was corrected, or something missing supplied
    """
    claims = [one for one in comparisons if one.decides == CLAIM]
    readings = {one.reading for one in claims}
    holding = [
        reading
        for reading in readings
        if all(one.agrees for one in claims if one.reading == reading)
    ]
    if not holding:
        return Verdict.NOT_REPRODUCIBLE
    if len(holding) < len(readings):
        return Verdict.ONE_READING
    if not all(one.agrees for one in comparisons if one.decides == NUMBER):
        return Verdict.CLAIM_ONLY
    return Verdict.WITH_CORRECTION if is_corrected else Verdict.REPRODUCED


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
