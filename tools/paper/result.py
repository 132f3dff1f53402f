"""The reproduction of one figure or table: pictures as PNG, a verdict, and a summary as JSON."""

import json
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from ...runtime.output_file import write_text


class Verdict(StrEnum):
    """How the paper's statement compares with the result."""

    REPRODUCED = "reproduced"
    WITH_CORRECTION = "reproduced with the stated correction"
    ONE_READING = "reproduced in one reading of the text, with the stated correction"
    CLAIM_ONLY = "the claim holds, not all numbers do"
    NOT_REPRODUCIBLE = "not reproducible from the text"


class Picture(NamedTuple):
    """One picture; ``name`` is that of its file, without suffix: figure_12, figure_12_filtered."""

    name: str
    figure: Figure


CLAIM, NUMBER = "claim", "number"
"""What a comparison may decide: a statement of the text, or a printed number."""


class Comparison(NamedTuple):
    """One figure of the paper and ours, as text with units.

    ``published``   what the paper prints, or states in words; "" where it states nothing
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


def verdict_of(comparisons: Sequence[Comparison]) -> Verdict:
    """Return the verdict of a corrected result that follows from the comparisons that decide."""
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
    return Verdict.WITH_CORRECTION


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


def write_reproduction(reproduction: Reproduction, folder: Path) -> None:
    """Write all files of a reproduction, the summary last; raises OSError."""
    for picture in reproduction.pictures:
        picture.figure.savefig(folder / f"{picture.name}.png")
    record = reproduction._asdict() | {
        "pictures": [picture.name for picture in reproduction.pictures],
        "comparisons": [comparison._asdict() for comparison in reproduction.comparisons],
    }
    file = folder / f"{reproduction.key}.json"
    write_text(file, json.dumps(record, indent=1, ensure_ascii=False))
