"""The report of a study: what it aggregates by hand, its bounds, and the page as a whole."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from steer_by_wire.closed_loop.studies.result_reader import Rows, held, read_results
from steer_by_wire.closed_loop.studies.study import Study
from steer_by_wire.plant_emulator.evaluation.run_verdict import Verdict
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.study import __main__, report
from steer_by_wire.tools.study.against_pd import comparison_section
from steer_by_wire.tools.study.law_by_delay import law_by_delay
from steer_by_wire.tools.study.report import PAGE, hand_wheel_section, reaction_sections, write
from tests.support.runs.small_study import CORNERS, complete
from tests.support.suite.unrendered import unrendered as unrendered

STUDY = (
    """
name = "small"
title = "Small & <quick>"
[base]
plant_preset = "paper_nominal"
controllers = ["practical_pd_ddob", "practical_pd"]
[base.plant]
duration_s = 8.0
path = "practical_ellipse"
disturbance = { steps = [{ at_s = 1.0, steering_offset_rad = 0.05 }] }
latency = { downlink = { model = "gamma" } }
safety = { ftti_ms = "off" }
[[factors]]
key = "plant.latency.downlink.mean_s"
values = [0.1, 0.9]
[[factors]]
name = "jitter"
key = "plant.latency.downlink.spread_fraction"
values = [0.0, 0.2]
[sampling]
seed = 7
replicates = 2
"""
    + CORNERS
)
RUNS = 2 * 2 * 4 * 2 * 2
PICTURES = ("error_over_delay",)
PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return complete(tmp_path_factory.mktemp("study"), text=STUDY).folder


@pytest.fixture(scope="module")
def study(results: Path) -> Study:
    return read_results(results)[0]


# The whole


def test_the_page_holds_everything_and_needs_nothing(results: Path) -> None:
    file, _ = write(results)
    text = file.read_text(encoding="utf-8")
    root = ET.fromstring(text.partition("\n")[2])  # noqa: S314 - our own page
    assert file == results / PAGE
    assert "Small &amp; <quick>" not in text
    assert next(root.iter("h2")).text == "Small & <quick>"
    for word in ("http:", "https:", "<script"):
        assert word not in text
    links = [link.get("href", "") for link in root.iter("a")]
    sections = [f"#{section.get('id')}" for section in root.iter("section")]
    assert links[: len(sections)] == sections  # a list of contents
    assert all(link.startswith("#") for link in links)
    paragraph = next(root.iter("p"))
    assert paragraph.get("class") == "verdict"
    assert re.fullmatch(r"\d+ of \d+ runs hold the path", paragraph.text or "")
    images = [image.get("src", "") for image in root.iter("img")]
    assert len(images) == len(PICTURES)
    assert all(source.startswith("data:image/png;base64,") for source in images)
    for name in PICTURES:
        assert (results / f"{name}.png").read_bytes().startswith(PNG)
    base = text.partition("Base of the plant")[2]
    assert "duration_s = 8.0" in base.partition("<details>")[0]
    assert "yaw_inertia" not in base.partition("<details>")[0]  # as by default: folded
    assert "yaw_inertia" in base.partition("</details>")[0]
    assert "Law by delay" in text
    assert "Against practical_pd" in text
    assert "Warning: runs of 8 s are judged by two windows of 2 s" in text


def test_a_folder_without_results_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SettingsError, match=r"study\.json: cannot be read"):
        write(tmp_path)
    assert __main__.main(["--report", str(tmp_path)]) == 2
    assert "give the folder of a study's results" in capsys.readouterr().err
    (tmp_path / "study.json").write_text("{}", encoding="utf-8")
    with pytest.raises(SettingsError, match="holds no results yet"):
        write(tmp_path)


def test_where_no_run_holds_the_page_compares_no_laws(
    results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    never = np.zeros(RUNS, np.bool_)
    monkeypatch.setattr(report, "held", lambda _rows: never)
    text = write(results)[0].read_text(encoding="utf-8")
    assert f"0 of {RUNS} runs hold" in text
    assert "Law by delay" not in text
    assert "Against" not in text


def test_latencies_whose_levels_have_names_are_on_no_axis(tmp_path: Path) -> None:
    named = STUDY.partition("[[factors]]")[0].replace("duration_s = 8.0", "duration_s = 1.0")
    named += """[[factors]]
name = "way"
[factors.levels]
short = { plant.latency.downlink.mean_s = 0.02 }
long = { plant.latency.downlink.mean_s = 0.3 }
"""
    folder = complete(tmp_path, text=named).folder
    assert law_by_delay(*read_results(folder)) is None


@pytest.mark.usefixtures("unrendered")
def test_the_page_of_drawn_factors_is_the_same_whenever_it_is_written(tmp_path: Path) -> None:
    drawn = STUDY.replace("values = [0.1, 0.9]", "start = 0.0\nstop = 0.9")
    drawn = drawn.replace("values = [0.0, 0.2]", "start = 0.0\nstop = 0.2")
    drawn = drawn.replace("duration_s = 8.0", "duration_s = 2.0").replace("at_s = 1.0", "at_s = 0")
    drawn = drawn.replace("seed = 7", 'seed = 7\nkind = "sobol"\ncount = 50')
    folder = complete(tmp_path, text=drawn).folder
    first = write(folder)[0].read_bytes()
    assert write(folder)[0].read_bytes() == first


def test_a_study_without_latencies_has_a_page_too(tmp_path: Path) -> None:
    bare = STUDY.partition("[[factors]]")[0].replace("duration_s = 8.0", "duration_s = 2.0")
    folder = complete(tmp_path, text=bare).folder
    assert "data:image/png;base64," not in write(folder)[0].read_text(encoding="utf-8")


# What is read and aggregated


def test_rows_are_read_as_they_are_stored(results: Path) -> None:
    study, rows = read_results(results)
    assert len(rows["id"]) == RUNS == study.runs
    np.testing.assert_array_equal(rows["id"], np.arange(RUNS))
    assert rows["controller"].tolist() == [*study.names] * (RUNS // 2)
    assert 0 < np.count_nonzero(held(rows)) < RUNS


def made_rows(rms_m: list[float], verdicts: list[Verdict], *names: str) -> dict[str, Any]:
    """Rows of one point, replicate by replicate, of these controllers."""
    count, error_m = len(rms_m), np.array(rms_m)
    figures = ("rms_m", "peak_m", "settled_rms_m", "steer_rate_rms_rad_s")
    unknown = ("grip_used_s", "fault_s", "reported_s", "reaction_s")
    return {
        "id": np.arange(count),
        "controller": np.array(names, dtype=object)[np.arange(count) % len(names)],
        "verdict": np.array([str(verdict) for verdict in verdicts], dtype=object),
        **dict.fromkeys(figures, error_m),
        "steer_rms_rad": error_m / 10.0,
        **dict.fromkeys(unknown, np.full(count, np.nan)),
        **dict.fromkeys(("limited_share", "mean_s", "jitter"), np.zeros(count)),
        "corner": np.array(["a", "b"], dtype=object)[np.arange(count) // (count // 2)],
    }


def test_reactions_are_counted_over_the_runs_with_a_fault(study: Study) -> None:
    one_law = study._replace(controllers={"practical_pd": study.controllers["practical_pd"]})
    rows = made_rows([1.0] * 4, [Verdict.HOLDS] * 4, "practical_pd")
    assert reaction_sections(one_law, rows) == []
    nan = np.nan
    rows |= {
        "fault_s": np.array([nan, 3.0, 3.0, 3.0]),
        "reported_s": np.array([nan, 0.01, 0.13, nan]),
    }
    (section,) = reaction_sections(one_law, rows)
    (line,) = section.tables[0].rows
    assert [cell.text for cell in line] == ["practical_pd", "3", "2", "70, 130", "0", "-", "1.000"]


def test_laws_are_compared_run_by_run_where_both_hold(study: Study) -> None:
    holds, cycle = Verdict.HOLDS, Verdict.LIMIT_CYCLE
    # practical_pd_ddob and practical_pd in turn
    rms_m = [1.0, 2.0, 3.0, 4.0, 50.0, 5.0, 6.0, 60.0]
    rows = made_rows(rms_m, [holds, holds, holds, holds, cycle, holds, holds, cycle], *study.names)
    (table,) = comparison_section(study, rows).tables
    ddob, pd = ([cell.text for cell in line] for line in table.rows)
    assert ddob[1:5] == ["3 (75.0 %)", "1", "1", f"{0.5 * (1 / 2 + 3 / 4):.3f}"]
    assert ddob[6] == "100.0 %"
    assert (pd[4], pd[6], pd[8]) == ("1.000", "0.0 %", "5,000")


def test_the_lines_of_a_hand_wheel_say_why_no_felt_delay_is_known() -> None:
    factor = SimpleNamespace(name="law", labels=("a", "b"), sets=lambda _key: False)
    rows: Rows = {
        "felt_delay_s": np.array([np.nan, np.nan, 0.01, 0.02, 0.02]),
        "hand_wheel_shakes_hz": np.array([np.nan, 1.0, np.nan, 1.0, np.nan]),
        "law": np.array([*"aabbb"]),
    }
    known = "law b: still up to 10.0 ms, shakes from 20.0 ms, not in all runs"
    for bus, ending in ((None, ""), ({}, f"; felt delay {report.FELT_DELAY_NOT_KNOWN}")):
        study: Any = SimpleNamespace(factors=[factor], bus=bus, hand_wheels={"": {}})
        _, lines = hand_wheel_section(study, rows)
        assert lines == [f"law a: 1 of 2 runs shake{ending}", known]
