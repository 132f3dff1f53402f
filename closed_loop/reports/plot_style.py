"""The look of every picture."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

from .law_colours import COLOURS, law_lines

LINES = cycler(
    color=(*COLOURS, "0.5"),
    linestyle=(
        "-", "--", "-.", (0, (1, 1)), (0, (7, 2)), (0, (4, 1, 1, 1, 1, 1)),
        (0, (2, 3)), (0, (9, 1, 3, 1)),
    ),
)  # fmt: skip
"""Of the first law, signal, ... to the eighth in a picture: they differ without colour too."""


def law_styles(laws: Iterable[str]) -> list[dict[str, Any]]:
    """Return colour and dash of the curves of a picture, each of a law."""
    return [
        {"color": colour, "linestyle": (0, dash) if dash else "-"}
        for colour, dash in law_lines(laws)
    ]


_STYLE = {
    "axes.grid": True,
    "axes.prop_cycle": LINES,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "figure.constrained_layout.use": True,
    "font.size": 10.0,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "savefig.dpi": 130,
}


@contextmanager
def plot_style() -> Iterator[None]:
    """Draw and save with this style inside the block."""
    with mpl.rc_context(_STYLE):  # type: ignore[arg-type]  # the stub knows only its own key names
        yield


def png_of(figure: Figure) -> bytes:
    """Return a figure as PNG, the same bytes for the same figure."""
    stream = BytesIO()
    with plot_style():
        figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()
