"""The index page: the result of each figure and table of the paper."""

from collections import Counter
from collections.abc import Callable, Sequence

from ...closed_loop.reports.page import Cell, Picture, Section, Table, number, page
from .result import Comparison, Reproduction, Verdict

_AGREES = {True: Cell("yes", "good"), False: Cell("no", "poor"), None: Cell("-")}

_MARKS_AND_MEANINGS = {
    Verdict.REPRODUCED: ("good", "what the paper prints gives what it says"),
    Verdict.WITH_CORRECTION: (
        "fair",
        "it does, once a misprint is mended or something every implementation needs is supplied;"
        " the correction is spelt out",
    ),
    Verdict.ONE_READING: ("fair", "it does so in one of the ways in which the text can be read"),
    Verdict.CLAIM_ONLY: (
        "fair",
        "what the text says holds, but not all numbers that it prints come out",
    ),
    Verdict.NOT_REPRODUCIBLE: (
        "poor",
        "the text leaves out what would be needed, or what it prints gives something else",
    ),
}

_ABOUT = (
    "Figures and tables of Wang and Guvenc, “Use of Robust DOB/CDOB Compensation to Improve "
    "Autonomous Vehicle Path Following Performance in the Presence of Model Uncertainty, CAN Bus "
    "Delays and External Disturbances”, computed by this project's own models and laws. Published "
    "is what the paper prints; where it is a picture only, what its text says of it."
)


def index_page(written: Sequence[Reproduction], read_png: Callable[[str], bytes]) -> str:
    """Return the page.

    ``written``   in the order in which they appear
    ``read_png``  returns the picture of a stem
    """
    about = Section("What is compared", [_ABOUT], tables=(_meanings(written), _summary(written)))
    sections = [_section(item, read_png) for item in written]
    counts = Counter(str(item.verdict) for item in written)
    verdict = "; ".join(f"{count}: {name}" for name, count in counts.most_common())
    return page("SAE 2018-01-1086, reproduced", [about, *sections], verdict)


def heading(item: Reproduction) -> str:
    """Return "Figure 8: title"."""
    kind, own_number, *_ = item.key.split("_")
    return f"{kind.capitalize()} {int(own_number)}: {item.title}"


def agreement(comparisons: Sequence[Comparison]) -> str:
    """Return how many of the comparisons that can agree do."""
    judged = [comparison.agrees for comparison in comparisons if comparison.agrees is not None]
    return f"{sum(judged)} of {len(judged)}" if judged else "-"


def _meanings(written: Sequence[Reproduction]) -> Table:
    rows = [
        (
            _verdict(verdict),
            Cell(meaning),
            number(str(sum(item.verdict is verdict for item in written))),
        )
        for verdict, (_, meaning) in _MARKS_AND_MEANINGS.items()
    ]
    return Table(("Verdict", "Means", "Here"), rows)


def _summary(written: Sequence[Reproduction]) -> Table:
    rows = [
        (
            Cell(heading(item), link=f"#{item.key}"),
            _verdict(item.verdict),
            number(agreement(item.comparisons)),
        )
        for item in written
    ]
    return Table(("Figure or table", "Verdict", "Comparisons that agree"), rows)


def _section(item: Reproduction, read_png: Callable[[str], bytes]) -> Section:
    pictures = [
        Picture(read_png(drawn.name), f"{heading(item)} ({drawn.name})") for drawn in item.pictures
    ]
    comparisons = Table(
        ("Quantity", "Published", "Reproduced", "Agrees"),
        [
            (Cell(one.quantity), _lines(one.published), _lines(one.reproduced), _AGREES[one.agrees])
            for one in item.comparisons
        ],
    )
    paragraphs = (_verdict(item.verdict), item.why, item.caption)
    return Section(heading(item), paragraphs, pictures, (comparisons,), key=item.key)


def _lines(text: str) -> Cell:
    """Return a text with each of its parts on its own line."""
    return Cell(text.replace("; ", "\n") or "-")


def _verdict(verdict: Verdict) -> Cell:
    return Cell(verdict, _MARKS_AND_MEANINGS[verdict][0])
