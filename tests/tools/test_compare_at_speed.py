"""The comparison on networks with memory, at road speed."""

from steer_by_wire.tools.compare_laws.at_speed import (
    LAWS,
    NETWORKS,
    PLACES,
    Cell,
    breaks_at,
    compare_at_speed,
    markdown_at_speed,
)


def test_every_network_gives_a_cell_and_a_row() -> None:
    done: list[tuple[int, int]] = []
    cells = compare_at_speed(
        (0.1,), 1, lambda *of: done.append(of), laws=("predictor",), places=PLACES[-1:]
    )
    assert done[-1] == (len(NETWORKS), len(NETWORKS))
    peaks_m = {cell.network: cell.peak_m for cell in cells}
    assert list(peaks_m) == list(NETWORKS)
    # The nominal car, and one of more than twice the mass.
    assert 1e-4 < peaks_m["constant"] < 0.05 < peaks_m["mass"] < 0.5
    rows = [line for line in markdown_at_speed(cells) if "| predictor |" in line]
    assert [row.split(" | ")[0].strip("| ") for row in rows] == [
        network.title for network in NETWORKS.values()
    ]


def test_it_breaks_where_the_lane_is_lost_first() -> None:
    cells = [
        Cell(60.0, "constant", next(iter(LAWS)), delay_s, peak_m, 0.0, 0.0, 0.0, 0.0, 0.0)
        for delay_s, peak_m in ((0.0, 0.1), (0.1, 0.51), (0.2, 0.1), (0.3, 9.0))
    ]
    assert breaks_at(cells) == "100"
    assert breaks_at(cells[:1]) == "-"
