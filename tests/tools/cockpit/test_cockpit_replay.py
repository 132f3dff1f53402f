"""The cockpit's replay, its page in one file, and the scenarios that a page can start."""

import gzip
import json
import math
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.closed_loop.recordings.log_analysis import analyse_files
from steer_by_wire.closed_loop.recordings.logged import LogError
from steer_by_wire.closed_loop.reports.law_colours import LAW_LINES
from steer_by_wire.tools.cockpit.page import page_files, served_page, single_page
from steer_by_wire.tools.cockpit.replay import read_replay
from steer_by_wire.tools.cockpit.scenario import choices, lane_settings, scenario_of, scenarios
from steer_by_wire.tools.cockpit.signals import NAMES, packed_row, packed_rows
from tests.support.programs.cockpit_run import fed
from tests.support.programs.cockpit_run import log as log


def head_of(block: bytes) -> Mapping[str, Any]:
    content = gzip.decompress(block)
    (length,) = struct.unpack_from("<I", content)
    head: Mapping[str, Any] = json.loads(content[4 : 4 + length])
    return head


def test_a_replay_ends_with_the_figures_of_the_analysis(log: Path) -> None:
    block = read_replay([log])
    head = head_of(block)
    wanted = analyse_files([log]).figures
    assert head["duration_s"] == pytest.approx(wanted["duration_s"])
    last = packed_row(head["duration_s"], fed(log)[0].row(fed(log)[1]))
    # The path is not known to a replay, so its place differs; the figures are the last two.
    assert gzip.decompress(block)[-8:] == last[-8:]
    (lane,) = head["lanes"]
    assert lane["lights"][-1][1][0]["state"] == "ACTIVE"
    colour, dash = lane["line"]
    assert (colour, tuple(dash)) == LAW_LINES["pd_ddob"]
    assert len(lane["frame_lists"]) == math.ceil(head["duration_s"] / lane["frame_list_s"])


def test_a_replay_of_a_log_that_was_cut_off_says_so(log: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.log"
    cut.write_bytes(log.read_bytes()[:2000])
    assert head_of(read_replay([log]))["bus"] == f"recording {log.name}"
    said = "recording cut.log, cut off: cut.log: the last line has no end"
    assert head_of(read_replay([cut]))["bus"].startswith(said)


def test_a_long_recording_has_fewer_rows_a_second(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("steer_by_wire.tools.cockpit.replay.ROWS_MAX", 256)
    head = head_of(read_replay([log]))
    assert head["row_period_s"] == pytest.approx(0.08)


def test_a_log_without_times_is_refused_in_one_line(tmp_path: Path) -> None:
    file = tmp_path / "no_times.log"
    file.write_text("  vcan0  100   [8]  00 00 00 00 00 00 00 00\n", encoding="ascii")
    with pytest.raises(LogError, match=r"no_times\.log: has no times, which a replay needs"):
        read_replay([file])


def test_the_one_file_loads_nothing() -> None:
    page = single_page(b"block", "a title")
    assert "<title>a title</title>" in page
    assert "src=" not in page.split('<script type="module"')[0].split("<style>")[0]
    assert 'rel="stylesheet"' not in page
    assert page.count("data:text/javascript;base64,") == sum(
        name.endswith(".js") and "/" not in name for name in page_files()
    )


def test_every_script_of_the_served_page_carries_the_nonce() -> None:
    page = served_page("secret")
    assert page.count("<script") == page.count('<script nonce="secret"') == 3


def test_no_file_of_the_page_names_an_address_to_load_from() -> None:
    own = {name: text for name, (text, _) in page_files().items() if not name.startswith("vendor/")}
    assert len(own) > 10
    loads = ("https://", "http://", "@import", "url(")
    found = [(n, w) for n, text in own.items() for w in loads if w in text]
    assert found == [("icon.svg", "http://")]  # the name of a namespace


# Scenarios


def test_every_scenario_has_settings_that_both_programs_accept() -> None:
    for scenario in scenarios():
        lanes = lane_settings(scenario)
        assert len(lanes) == len(scenario.controllers)
        assert {lane.plant.seed for lane in lanes} == {scenario.seed}
    assert json.dumps(choices(), allow_nan=False)


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"controllers": ["nosuch"]}, "preset 'nosuch': there is none of this name"),
        ({"controllers": []}, "the page: controllers"),
        ({"speed_km_h": 1000.0}, "the page: speed_km_h = 1000.0"),
        ({"path": "a ditch"}, "the page: path"),
        ({"plant": "nosuch"}, "preset 'nosuch': there is none of this name"),
        ({"downlink": {"loss": 2.0}}, "the page: downlink.loss = 2.0"),
        ({"nosuch": 1}, "the page: nosuch"),
    ],
)
def test_a_bad_choice_is_refused_in_one_line(values: dict[str, object], line: str) -> None:
    with pytest.raises(ValueError, match=line):
        lane_settings(scenario_of(values))


def test_a_batch_of_rows_is_what_its_header_says() -> None:
    row = packed_row(1.5, range(len(NAMES)))
    batch = packed_rows(3, [row, row])
    assert len(batch) == 8 + 2 * len(row) == 8 + 2 * (8 + 4 * len(NAMES))
    assert batch[:8] == bytes([1, 3, len(NAMES), 0, 2, 0, 0, 0])
