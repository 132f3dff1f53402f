"""Curves that a reader can tell apart in a picture printed without colour."""

from collections import Counter

import numpy as np
from matplotlib.figure import Figure


def alike_without_colour(figure: Figure, *, every_curve: bool = False) -> list[str]:
    """Return the named curves of a panel that have marks, width and dashes of another.

    ``every_curve``  compare those without a name too, but no straight line or legend's sample
    """
    found = []
    for axes in figure.axes:
        looks = {}
        for line in axes.get_lines():
            is_curve = len(np.asarray(line.get_xdata())) > 2
            if is_curve if every_curve else not str(line.get_label()).startswith("_"):
                dashes = str(line.get_linestyle()), str(vars(line)["_unscaled_dash_pattern"])
                looks[str(line.get_label())] = dashes, line.get_marker(), line.get_linewidth()
        counts = Counter(looks.values())
        found += [name for name, look in looks.items() if counts[look] > 1]
    return found
