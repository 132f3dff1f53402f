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
            unit = "" if (breaks := _breaks(own)) == "-" else " ms"
            lines.append(f"{one.label:24}{settled}   {breaks}{unit}")
            lines.append(f"{'  the whole run':24}{whole}")
    return [
        *lines,
        f"\nA law's own row is from {SETTLED_S:g} s on; the row below it counts the beginning too.",
        f"breaks at: first delay with more than {1e3 * BROKEN_M:g} mm from {SETTLED_S:g} s on;"
        " ! is beyond that",
    ]


def markdown_lines(cells: Sequence[Cell], further: Sequence[Contestant] = ()) -> list[str]:
    """Return the first network in full, where each law breaks, and the other networks."""
    shown, compact = _measured(cells, SHOWN_MS), _measured(cells, COMPACT_MS)
    (first, network), *others = NETWORKS.items()
    full = []
    for one in contestants_of(network, further):
        own = _cells_of(cells, first, one.label)
        full.append([one.label, *(_with_whole_run(own[ms]) for ms in shown)])
    breaks, beside = [], []
    for one in (*CONTESTANTS, *further):
        own_by_network = {key: _cells_of(cells, key, one.label) for key in NETWORKS}
        breaks.append([one.label, *(_breaks(own) for own in own_by_network.values())])
        if any(own_by_network[key] for key, _ in others):
            beside.append([one.label, *(_some(own_by_network[key], compact) for key, _ in others)])
    delays = " / ".join(str(ms) for ms in compact)
    return [
        *_markdown(["RMS [mm] at", *(f"{ms} ms" for ms in shown)], full),
        "",
        *_markdown(["breaks at [ms]", *(one.short for one in NETWORKS.values())], breaks),
        "",
        *_markdown([f"RMS [mm] at {delays} ms", *(one.short for _, one in others)], beside),
    ]


def _cells_of(cells: Sequence[Cell], network: str, label: str) -> CellsByMs:
    """Return a law's cells in a network by delay [ms]."""
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
    settled, whole = _in_mm(cell.settled_rms_m), _in_mm(cell.rms_m)
    return settled if settled == "-" else f"{settled} ({whole})"


def _some(own: CellsByMs, some_ms: Sequence[int]) -> str:
    return " / ".join(_in_mm(own[ms].settled_rms_m) for ms in some_ms) if own else ""


def _in_mm(rms_m: float, beyond: str = "-") -> str:
    if rms_m > BROKEN_M:
        return beyond
    return f"{1e3 * rms_m:.2f}" if rms_m < 0.01 else f"{1e3 * rms_m:.1f}"


def _markdown(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    return [
        f"| {' | '.join(cells).rstrip()} |" for cells in (heading, ["---"] * len(heading), *rows)
    ]
