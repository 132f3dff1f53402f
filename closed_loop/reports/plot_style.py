"""The look of every picture."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BytesIO
from itertools import cycle
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette, distinct with any colour vision."""

LINES = cycler(
    color=(*COLOURS, "0.5"),
    linestyle=(
        "-", "--", "-.", (0, (1, 1)), (0, (7, 2)), (0, (4, 1, 1, 1, 1, 1)),
        (0, (2, 3)), (0, (9, 1, 3, 1)),
    ),
)  # fmt: skip
"""Of the first law, signal, ... to the eighth in a picture: they differ without colour too."""

_LAWS = {
    "pd": (COLOURS[6], "-"),
    "pd_cdob": (COLOURS[0], "--"),
    "pd_dob": (COLOURS[4], (0, (4, 1, 1, 1, 1, 1))),
    "pd_ddob": (COLOURS[3], "-."),
    "pid": (COLOURS[1], (0, (7, 2))),
    "predictor": (COLOURS[2], (0, (3, 1, 1, 1))),
    "packet": (COLOURS[5], (0, (1, 1))),
    "smith": ("0.5", (0, (2, 3))),
}
"""Colour and dash of each law by its name in the settings, the same in all pictures."""
_OTHER = "0.5", None
_SPARE = ((0, (5, 1)), (0, (1, 3)), (0, (8, 2, 2, 2)), (0, (3, 3)), (0, (6, 1, 1, 1, 1, 1)))
"""Dashes of further curves of a law, and of laws of others."""


def law_styles(laws: Iterable[str]) -> list[dict[str, Any]]:
    """Return colour and dash of the curves of a picture, each of a law."""
    spare, styles, drawn = cycle(_SPARE), list[dict[str, Any]](), set[str]()
    for law in laws:
        colour, dash = _LAWS.get(law, _OTHER)
        styles.append({"color": colour, "linestyle": next(spare) if law in drawn else dash})
        if law not in _LAWS:
            styles[-1]["linestyle"] = next(spare)
        drawn.add(law)
    return styles


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
