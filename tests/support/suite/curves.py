"""What a reader can tell apart in a picture that is printed without colour."""

from collections import Counter

from matplotlib.figure import Figure


def alike_without_colour(figure: Figure) -> list[str]:
    """Return the named curves of a panel that have marks, width and dashes of another."""
    found = []
    for axes in figure.axes:
        looks = {}
        for line in axes.get_lines():
            if not str(line.get_label()).startswith("_"):
                dashes = str(line.get_linestyle()), str(vars(line)["_unscaled_dash_pattern"])
                looks[str(line.get_label())] = dashes, line.get_marker(), line.get_linewidth()
        counts = Counter(looks.values())
        found += [name for name, look in looks.items() if counts[look] > 1]
    return found
