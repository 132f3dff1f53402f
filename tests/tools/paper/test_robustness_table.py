"""The table of what the laws tolerate: its text, its drawing and its files."""

import math

import numpy as np
import pytest

from steer_by_wire.controller.analysis.stable_delays import DELAY_NS_MAX, DelayInterval
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.tools.paper import robustness_table as table
from steer_by_wire.tools.paper.corners import corner_plants
from steer_by_wire.tools.paper.result import Verdict

MS_NS = 1_000_000
PUBLISHED_1_KHZ, PUBLISHED_100_HZ, FILTERED, PRACTICAL = table.VARIANTS


def common_ms(row: table.Row) -> list[tuple[float, float]]:
    common = table.common_delays([corner.stable for corner in row.corners])
    return [(first / MS_NS, last / MS_NS) for first, last in common]


@pytest.fixture
def without_jitter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what takes longest."""
    monkeypatch.setattr(table, "stable_spreads", lambda *_: ())


def test_delays_in_common_are_those_in_every_set() -> None:
    first = (DelayInterval(0, 10), DelayInterval(20, 40), DelayInterval(60, 70))
    second = (DelayInterval(5, 30), DelayInterval(35, 65))
    assert table.common_delays([first, second]) == (
        DelayInterval(5, 10),
        DelayInterval(20, 30),
        DelayInterval(35, 40),
        DelayInterval(60, 65),
    )
    assert table.common_delays([first, ()]) == ()
    assert table.common_delays([]) == (DelayInterval(0, DELAY_NS_MAX),)


def test_at_1_khz_the_published_gains_lose_a_corner_below_ten_milliseconds() -> None:
    (row,) = table.table_rows((PUBLISHED_1_KHZ,), ("pd",))
    ((_, last_ms),) = common_ms(row)
    assert 8.0 < last_ms < 9.5
    assert all(corner.spreads is None for corner in row.corners)  # too many commands on their way


@pytest.mark.usefixtures("without_jitter")
def test_at_100_hz_they_lose_it_earlier_and_the_cdob_is_stable_nowhere() -> None:
    pd, cdob = table.table_rows((PUBLISHED_100_HZ,), ("pd", "pd_cdob"))
    ((_, last_ms),) = common_ms(pd)
    assert 3.0 < last_ms < 4.0
    assert all(corner.stable == () for corner in cdob.corners)


@pytest.mark.usefixtures("without_jitter")
def test_a_washout_mends_the_cdob() -> None:
    pd, cdob = table.table_rows((FILTERED,), ("pd", "pd_cdob"))
    ((_, pd_ms),), ((_, cdob_ms),) = common_ms(pd), common_ms(cdob)
    assert 35.0 < pd_ms < 40.0
    assert cdob_ms > 5.0 * pd_ms


def test_pd_at_a_fast_corner_tolerates_80_ms_that_vary_enough() -> None:
    """But not a constant 80 ms."""
    settings = controller_preset(f"{FILTERED.family}_pd", FILTERED.overrides)
    spreads = table.robustness(settings, corner_plants()[3]).spreads
    assert spreads is not None
    assert spreads[0].first_ns > 40 * MS_NS
    assert spreads[-1].last_ns == table.JITTER_MEAN_NS


@pytest.mark.usefixtures("without_jitter")
def test_the_practical_presets_keep_every_corner_stable_up_to_250_ms() -> None:
    (row,) = table.table_rows((PRACTICAL,), ("pd",))
    ((first_ms, last_ms),) = common_ms(row)
    assert (first_ms, last_ms > 250.0) == (0.0, True)
    assert all(corner.margins.peak_sensitivity < 2.0 for corner in row.corners)


def test_what_is_drawn_is_written_down_row_by_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "VARIANTS", (FILTERED,))
    monkeypatch.setattr(table, "LAWS", {"pd": "PD"})
    result = table.robustness_table()
    assert (result.key, result.verdict) == ("robustness_table", Verdict.BEYOND)
    delays, margins = result.pictures
    assert delays.name == result.key
    corner, last_ms = delays.columns["corner"], delays.columns["last_ms"]
    assert list(corner) == [0, 1, 2, 3, 4]  # 4: all corners
    assert last_ms[4] == min(last_ms[:4])
    assert np.allclose(margins.columns["delay_margin_ms"], last_ms[:4])
    assert np.all(margins.columns["phase_rad"] < math.pi)
    assert {len(values) for values in margins.columns.values()} == {4}
    (comparison,) = result.comparisons
    assert f"delay margin {last_ms[4]:.1f} ms" in comparison.reproduced
    assert comparison.agrees is None
