"""The tables of the comparison: as text to be printed, and as Markdown for a document."""

from collections.abc import Iterable, Mapping, Sequence

from .runs import (
    BROKEN_M,
    CONTESTANTS,
    NETWORKS,
    SETTLED_S,
    Cell,
    Contestant,
    breaks_at_s,
    contestants_of,
)

SHOWN_MS = (0, 100, 200, 300, 400, 500, 600)
COMPACT_MS = (100, 200, 300, 400, 500)
SHOWN_M_MAX = 0.3
"""A larger RMS is not printed. A law that follows the preview point leaves the centre of gravity up
to some 140 mm off the path."""
CellsByMs = Mapping[int, Cell]


def table_lines(cells: Sequence[Cell], further: Sequence[Contestant] = ()) -> list[str]:
    """Return a table for each network: RMS [mm] at some delays, and where each law breaks."""
    shown = _measured(cells, SHOWN_MS)
    lines = []
    for key, network in NETWORKS.items():
        lines += ["", f"{network.title}: worst RMS over the box [mm]"]
        lines.append(f"{'delay [ms]':24}" + "".join(f"{ms:>9}" for ms in shown) + "   breaks at")
        for one in contestants_of(network, further):
            own = _cells_of(cells, key, one.label)
            settled = "".join(f"{_in_mm(own[ms].settled_rms_m, '!'):>9}" for ms in shown)
            whole = "".join(f"{_in_mm(own[ms].rms_m, '!'):>9}" for ms in shown)
            cg = "".join(f"{_in_mm(own[ms].settled_cg_rms_m, '!'):>9}" for ms in shown)
            unit = "" if (breaks := _breaks(own)) == "-" else " ms"
            lines.append(f"{one.label:24}{settled}   {breaks}{unit}")
            lines.append(f"{'  the whole run':24}{whole}")
            lines.append(f"{'  centre of gravity':24}{cg}")
    return [
        *lines,
        f"\nA law's own row: preview point, from {SETTLED_S:g} s on; below it the whole run and the"
        f"\ncentre of gravity, from {SETTLED_S:g} s on, which laws named CG hold on the path.",
        f"breaks at: first delay at which the followed point has more than {1e3 * BROKEN_M:g} mm"
        f" from {SETTLED_S:g} s on; ! is beyond {1e3 * SHOWN_M_MAX:g} mm",
    ]


def markdown_lines(cells: Sequence[Cell], further: Sequence[Contestant] = ()) -> list[str]:
    """Return the first network in full, where each law breaks, and the other networks."""
    shown, compact = _measured(cells, SHOWN_MS), _measured(cells, COMPACT_MS)
    (first, network), *others = NETWORKS.items()
    full, of_cg = [], []
    for one in contestants_of(network, further):
        own = _cells_of(cells, first, one.label)
        full.append([one.label, *(_with_whole_run(own[ms]) for ms in shown)])
        of_cg.append([one.label, *(_in_mm(own[ms].settled_cg_rms_m) for ms in shown)])
    breaks, beside = [], []
    for one in (*CONTESTANTS, *further):
        own_by_network = {key: _cells_of(cells, key, one.label) for key in NETWORKS}
        breaks.append([one.label, *(_breaks(own) for own in own_by_network.values())])
        if any(own_by_network[key] for key, _ in others):
            beside.append([one.label, *(_some(own_by_network[key], compact) for key, _ in others)])
    delays = " / ".join(str(ms) for ms in compact)
    return [
        *_markdown(["followed point, RMS [mm] at", *(f"{ms} ms" for ms in shown)], full),
        "",
        *_markdown(["centre of gravity, RMS [mm] at", *(f"{ms} ms" for ms in shown)], of_cg),
        "",
        *_markdown(["breaks at [ms]", *(one.short for one in NETWORKS.values())], breaks),
        "",
        *_markdown([f"RMS [mm] at {delays} ms", *(one.short for _, one in others)], beside),
    ]


def _cells_of(cells: Sequence[Cell], network: str, label: str) -> CellsByMs:
    own = [cell for cell in cells if (cell.network, cell.contestant) == (network, label)]
    return {round(1e3 * cell.delay_s): cell for cell in own}


def _measured(cells: Sequence[Cell], asked_ms: Sequence[int]) -> list[int]:
    measured = {round(1e3 * cell.delay_s) for cell in cells}
    return [ms for ms in asked_ms if ms in measured]


def _breaks(own: CellsByMs) -> str:
    """Return the first delay [ms] at which a law breaks; nothing if it does not take part."""
    if not own:
        return ""
    broken_s = breaks_at_s(list(own.values()))
    return "-" if broken_s is None else f"{1e3 * broken_s:.0f}"


def _with_whole_run(cell: Cell) -> str:
    settled_m, whole_m = cell.followed_m
    if settled_m > BROKEN_M:
        return "-"
    return f"{_in_mm(settled_m)} ({_in_mm(whole_m)})"


def _some(own: CellsByMs, some_ms: Sequence[int]) -> str:
    shown_m = [own[ms].followed_m[0] for ms in some_ms] if own else []
    return " / ".join(_in_mm(value_m, at_most_m=BROKEN_M) for value_m in shown_m)


def _in_mm(rms_m: float, beyond: str = "-", at_most_m: float = SHOWN_M_MAX) -> str:
    if rms_m > at_most_m:
        return beyond
    return f"{1e3 * rms_m:.2f}" if rms_m < 0.01 else f"{1e3 * rms_m:.1f}"


def _markdown(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    return [
        f"| {' | '.join(cells).rstrip()} |" for cells in (heading, ["---"] * len(heading), *rows)
    ]
