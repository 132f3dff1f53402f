"""Quantiles over seeds: by hand, their interval by its definition, and as a page."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from steer_by_wire.closed_loop.studies.result_reader import Rows, StudyRecord, read_rows, read_study
from steer_by_wire.tools.study.quantiles_over_seeds import beyond, seeds_section
from tests.support.suite.combinations import sampled
from tests.tools.study.test_study_report import computed

STUDY = """
name = "seeds"
[base]
plant_preset = "paper_nominal"
controllers = ["practical_pd", "practical_pid"]
plant.duration_s = 1.0
[[factors]]
name = "network"
[factors.levels."gamma"]
plant.latency.downlink = { model = "gamma", mean_s = 0.1, spread_s = 0.05 }
[factors.levels."lossy"]
plant.latency.downlink = { loss = 0.3 }
[sampling]
replicates = 100
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> tuple[StudyRecord, Rows]:
    study = read_study(computed(tmp_path_factory.mktemp("seeds"), STUDY))
    return study, read_rows(study)


def table(study: StudyRecord, rows: Rows) -> list[list[str]]:
    section = seeds_section(study, rows)
    assert section is not None
    return [[cell.text for cell in row] for row in section.tables[0].rows]


def test_each_network_and_law_has_its_quantiles_by_rank(results: tuple[StudyRecord, Rows]) -> None:
    study, rows = results
    lossy_pid = np.flatnonzero((rows.factors["network"] == "lossy") & (rows.controller == 1))
    peak_m = np.full(len(rows.id), 0.3)
    peak_m[lossy_pid] = 0.01 * np.random.default_rng(1).permutation(np.arange(1, 101))
    found = table(study, rows._replace(peak_m=peak_m, rms_m=0.5 * peak_m))
    assert [line[:2] for line in found] == [
        ["gamma", "practical_pd"],
        ["gamma", "practical_pid"],
        ["lossy", "practical_pd"],
        ["lossy", "practical_pid"],
    ]
    assert found[0][2:] == ["0.30"] * 4 + ["0.15"] * 2 + ["0.0 (0.0 to 3.6)"]
    assert found[3][2:8] == ["0.50", "0.95", "0.99", "1.00", "0.49", "0.50"]


def test_a_run_that_ended_early_counts_as_lost(results: tuple[StudyRecord, Rows]) -> None:
    study, rows = results
    peak_m = rows.peak_m.copy()
    peak_m[np.flatnonzero(rows.controller == 0)[0]] = np.nan
    line = table(study, rows._replace(peak_m=peak_m))[0]
    assert line[5] == "lost"
    assert line[-1].startswith("1.0 (0.0 to 5.4)")


def test_a_few_seeds_give_no_quantiles(results: tuple[StudyRecord, Rows]) -> None:
    study, rows = results
    few = study._replace(sampling={**study.sampling, "replicates": 99})
    assert seeds_section(few, rows) is None


@given(st.integers(1, 2000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_the_interval_leaves_a_fortieth_on_either_side(counted: tuple[int, int]) -> None:
    count, runs = counted
    text = beyond(np.where(np.arange(runs) < count, 2.0, 0.1), 0.5)
    share, low, high = (float(word.strip("()")) for word in text.replace(" to ", " ").split(" "))
    assert share == pytest.approx(100 * count / runs, abs=0.0501)
    edge = 0.000501  # half of the last digit
    if count:
        assert binom.sf(count - 1, runs, max(0.01 * low - edge, 0.0)) <= 0.025
        assert binom.sf(count - 1, runs, min(0.01 * low + edge, 1.0)) >= 0.025
    if count < runs:
        assert binom.cdf(count, runs, min(0.01 * high + edge, 1.0)) <= 0.025
        assert binom.cdf(count, runs, max(0.01 * high - edge, 0.0)) >= 0.025


PAGE = Path(__file__).parents[3] / "docs" / "packet.md"
SEEDS = 10
ON_PAGE_S = ("0.2", "0.4")
MEANS_S = sampled(ON_PAGE_S[1:], ON_PAGE_S)


def test_the_page_of_plans_says_what_the_same_seeds_give(tmp_path: Path) -> None:
    """The first of the thousand seeds, computed again."""
    shipped = Path(__file__).parents[3] / "closed_loop" / "studies" / "compare_at_speed.toml"
    text = shipped.read_text(encoding="utf-8")
    few = text.replace("[0.0, 0.1, 0.2, 0.3, 0.4]", f"[{', '.join(MEANS_S)}]")
    few = few.replace("= 1000", f"= {SEEDS}")
    few = re.sub(r"\[[^]]*5000 kg\"\]\n(.*= .*\n)+", "", few)  # not on the page
    study = read_study(computed(tmp_path, few))
    rows = read_rows(study)
    lines, network = [], ""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if re.fullmatch(r"\*\*.*\*\*", line):
            network = line.strip("*")
        if line.count("|") == 6 and " to " in line:
            law, *cells = (cell.strip() for cell in line.strip("|").split("|"))
            for mean_s, peaks_m, beyond in zip(ON_PAGE_S, cells[::2], cells[1::2], strict=True):
                if mean_s in MEANS_S:
                    lines.append([network, mean_s, law, *peaks_m.split(", "), beyond])
    assert len(lines) == 2 * len(MEANS_S) * 4
    for network, mean_s, law, *figures in lines:
        at = (
            (rows.factors["network"] == network)
            & (rows.factors["mean_s"] == float(mean_s))
            & (rows.controller == study.names.index(law))
        )
        peak_m = rows.peak_m[at]
        assert len(peak_m) == SEEDS
        median_m, _, worst_m = (
            math.inf if figure == "lost" else float(figure) for figure in figures[:3]
        )
        half_digit = 0.00501
        assert peak_m.max() <= worst_m + half_digit, (network, mean_s, law)
        if median_m < math.inf:  # all on one side with a probability of 1e-3
            assert peak_m.min() <= median_m + half_digit
            assert peak_m.max() >= median_m - half_digit
        share = float(figures[-1].split()[0])
        count = np.count_nonzero(peak_m > 0.5)
        assert binom.cdf(count, SEEDS, 0.01 * share + 5e-4) > 1e-6
        assert binom.sf(count - 1, SEEDS, 0.01 * share + 5e-4) > 1e-6
