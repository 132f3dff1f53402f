"""The program that reproduces the paper, on one cheap figure; its page; bad input."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from matplotlib.figure import Figure
from rich.console import Console

from steer_by_wire.tools.paper import __main__ as reproduce_paper
from steer_by_wire.tools.paper.__main__ import MODULES, numbers_of
from steer_by_wire.tools.paper.index_page import index_page
from steer_by_wire.tools.paper.result import (
    Comparison,
    Picture,
    Reproduction,
    Verdict,
    write_reproduction,
)
from tests.support.suite.same_process import same_process as same_process
from tests.support.suite.unrendered import unrendered as unrendered

PNG = b"\x89PNG\r\n\x1a\n"
COMPARISONS = (
    Comparison("RMS", "0.1 m", "0.1 m; peak 0.2 m", True),
    Comparison("peak", "0.3 m", "0.2 m", False),
    Comparison("end", "", "0.0 m", None),
)


def written(key: str = "figure_08", verdict: Verdict = Verdict.REPRODUCED) -> Reproduction:
    pictures = tuple(Picture(name, Figure()) for name in ("one", "two"))
    return Reproduction(key, "A title", "A caption", pictures, COMPARISONS, verdict, "A reason")


def page_of(*items: Reproduction) -> str:
    return index_page(items, lambda _: PNG)


def parsed(page: str) -> ET.Element:
    return ET.fromstring(page)  # noqa: S314  # our own page


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("paper")
    assert reproduce_paper.main(["--figure", "8", "--out", str(folder)]) == 0
    return folder


def test_one_figure_leaves_its_picture_its_summary_and_the_page(out: Path) -> None:
    assert {path.name for path in out.iterdir()} == {
        "figure_08.png",
        "figure_08.json",
        "index.html",
    }
    assert (out / "figure_08.png").read_bytes().startswith(PNG)
    summary = json.loads((out / "figure_08.json").read_text(encoding="utf-8"))
    assert summary["verdict"] == Verdict.WITH_CORRECTION


def test_the_page_of_a_run_is_self_contained_and_well_formed(out: Path) -> None:
    text = (out / "index.html").read_text(encoding="utf-8")
    root = parsed(text)
    assert [image.get("src", "")[:22] for image in root.iter("img")] == ["data:image/png;base64,"]
    assert [link.get("href") for link in root.iter("a")] == ["#figure_08"]
    assert root.find(".//section[@id='figure_08']") is not None
    assert not re.search(r"<script|<link|@import|url\(|https?:", text)
    assert Verdict.NOT_REPRODUCIBLE in text


def test_the_page_says_every_verdict_and_every_comparison() -> None:
    items = [written(key, verdict) for key, verdict in zip(MODULES, Verdict, strict=False)]
    root = parsed(page_of(*items))
    for item in items:
        section = root.find(f".//section[@id='{item.key}']")
        assert section is not None
        text = "".join(section.itertext())
        for expected in (item.verdict, item.why, item.caption, "0.3 m", "peak 0.2 m"):
            assert expected in text


def test_whatever_a_figure_says_is_escaped() -> None:
    evil = "<script>alert('&')</script>"
    item = Reproduction(
        f"figure_8_{evil}",
        evil,
        evil,
        (Picture(evil, Figure()),),
        (Comparison(evil, evil, evil, None),),
        Verdict.REPRODUCED,
        evil,
    )
    text = page_of(item)
    assert "<script" not in text
    root = parsed(text)
    assert "".join(root.itertext()).count("<script>") == 7


@pytest.mark.usefixtures("same_process", "unrendered")
def test_a_figure_that_fails_does_not_keep_the_others_from_being_written(tmp_path: Path) -> None:
    with pytest.raises(KeyError, match="figure_99"):
        reproduce_paper.reproduce_all(("figure_99", "figure_08"), tmp_path, Console(quiet=True))
    assert "figure_08" in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_figures_are_on_the_page_in_the_paper_s_order(tmp_path: Path) -> None:
    done = []
    for key in ("table_2", "figure_09"):
        picture = Picture(key, Figure())
        made = Reproduction(key, "t", "c", (picture,), COMPARISONS, Verdict.REPRODUCED, "w")
        write_reproduction(made, tmp_path)
        done.append(made)
    page = reproduce_paper.write_index(tmp_path, done).read_text(encoding="utf-8")
    assert re.findall(r'<section id="(\w+)">', page) == ["s1", "figure_09", "table_2"]
    assert json.loads((tmp_path / "table_2.json").read_bytes())["key"] == "table_2"


def test_numbers_select_in_the_paper_s_order_and_none_select_all() -> None:
    assert numbers_of("figure") == (*map(str, range(7, 13)), *map(str, range(16, 25)))
    keys = reproduce_paper.selected(["21", "8"], ["2"])
    assert keys == ("figure_08", "table_2", "figure_21")
    assert reproduce_paper.selected([], []) == tuple(MODULES)
