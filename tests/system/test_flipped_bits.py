"""No flipped bit of a file that a tool reads again makes another figure: it is refused or left out.

Results of a study have a test of their own beside their reader; a log is damaged line by line.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.design.frontier import frontier
from steer_by_wire.tools.design.frontier.frontier import Row
from steer_by_wire.tools.design.frontier.sweep import Point
from steer_by_wire.tools.design.frontier.trials import Trials
from steer_by_wire.tools.design.search.stop_and_resume import KeptCosts
from steer_by_wire.tools.faults.campaign.execution import keep_only, read_stored
from tests.fuzz.campaign_targets import whole_result

RESULT = whole_result()
COSTS = {f"design {n}": 1.0 / (n + 3) for n in range(4)}


class Kept(NamedTuple):
    """A file that is read again: what writes it, what reads it, and whether parts may be gone."""

    name: str
    write: Callable[[Path], object]
    read: Callable[[Path], Any]
    is_by_line: bool = False


def write_costs(folder: Path) -> None:
    kept = KeptCosts(folder / "costs", "a digest")
    for what, cost in COSTS.items():
        kept.cost(what, lambda cost=cost: cost)


def read_costs(folder: Path) -> list[float]:
    kept = KeptCosts(folder / "costs", "a digest")
    return [cost for what in COSTS if (cost := kept.cost(what, lambda: -1.0, -2.0)) != -1.0]


def frontier_rows() -> list[Row]:
    numbers = iter(0.1 * n for n in range(100))
    point = {
        name: {"pd.gain": 0.5} if name == "values" else next(numbers) for name in Point._fields
    }
    trials = Trials(*(next(numbers) for _ in Trials._fields))
    return [Row(Point(**{**point, "structure": "PD"}), trials)]


def write_frontier(folder: Path) -> None:
    frontier._write(folder / "pd.json", "a digest", frontier_rows())


FILES = (
    Kept(
        "results.jsonl",
        lambda folder: keep_only(folder, "a", [RESULT, RESULT._replace(seed=RESULT.seed + 1)]),
        lambda folder: [result for of, result in read_stored(folder).results if of == "a"],
        is_by_line=True,
    ),
    Kept("costs", write_costs, read_costs, is_by_line=True),
    Kept(
        "pd.json",
        write_frontier,
        lambda folder: frontier._read(folder / "pd.json", "a digest") or [],
        is_by_line=True,
    ),
)
"""Each file of figures that some tool reads again, and is text."""


@pytest.fixture(scope="module", params=FILES, ids=[kept.name for kept in FILES])
def kept(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return one of them, its folder, its content, and what is read from it."""
    one = request.param
    folder = tmp_path_factory.mktemp("kept")
    one.write(folder)
    return one, folder, (folder / one.name).read_bytes(), one.read(folder)


def test_what_was_written_is_read_again(kept: Any) -> None:
    _, _, _, whole = kept
    assert len(whole) > 0


@given(share=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
@settings(deadline=None, max_examples=60)
def test_no_flipped_bit_makes_another_figure(kept: Any, share: float, bit: int) -> None:
    one, folder, content, whole = kept
    place = int(share * len(content))
    flipped = bytes([content[place] ^ 1 << bit])
    (folder / one.name).write_bytes(content[:place] + flipped + content[place + 1 :])
    try:
        read = one.read(folder)
    except SettingsError:
        return
    assert read == whole or (one.is_by_line and all(figure in whole for figure in read))
