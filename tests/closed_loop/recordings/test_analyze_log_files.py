"""Files that the analysis of a log leaves: tables for other programs, and its report."""

import csv
import os
import re
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from steer_by_wire.closed_loop.recordings.logged import Logged
from steer_by_wire.closed_loop.reports.plot_style import png_of
from steer_by_wire.dbc.messages import LateralError, encode
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.tools.analyze import pictures
from steer_by_wire.tools.analyze.__main__ import main
from tests.support.frames.made_messages import command_of, message_with
from tests.support.runs.logged_run import Run, write_log, written
from tests.support.runs.logged_run import constant as constant
from tests.support.runs.logged_run import varying as varying
from tests.support.suite.curves import alike_without_colour
from tests.support.suite.unrendered import unrendered as unrendered

Capture = pytest.CaptureFixture[str]


@pytest.mark.usefixtures("unrendered")
def test_the_table_holds_the_newest_of_every_signal(tmp_path: Path) -> None:
    command = command_of(0.12345, 7)
    path = write_log(
        tmp_path / "run.log",
        [
            Logged(5_000_000, "c", encode(command, 0)),
            Logged(
                7_500_000,
                "c",
                encode(
                    message_with(LateralError, lateral_error_m=-0.25, heading_error_rad=0.002), 0
                ),
            ),
            Logged(9_000_000, "c", encode(command._replace(steer_rad=0.2), 1)),
        ],
    )
    written(tmp_path / "out", path)
    text = (tmp_path / "out" / "run" / "signals.csv").read_text("ascii")
    rows = list(csv.DictReader(text.splitlines()))
    assert [(row["time_s"], row["message"]) for row in rows] == [
        ("0.000000", "STEERING_COMMAND"),
        ("0.002500", "LATERAL_ERROR"),
        ("0.004000", "STEERING_COMMAND"),
    ]
    assert [row["steering_command.steer_rad"] for row in rows] == ["0.12345", "0.12345", "0.2"]
    assert [row["steering_command.mode"] for row in rows] == ["1", "1", "1"]
    assert [row["lateral_error.lateral_error_m"] for row in rows] == ["", "-0.25", "-0.25"]
    assert all(row["plant_status.lost"] == "" for row in rows)


def test_the_report_needs_nothing_but_itself(
    varying: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alike: list[str] = []

    def rendered(figure: Figure) -> bytes:
        alike.extend(alike_without_colour(figure, every_curve=True))
        return png_of(figure)

    monkeypatch.setattr(pictures, "png_of", rendered)
    written(tmp_path / "out", varying.log)
    assert not alike
    page = (tmp_path / "out" / "run" / "report.html").read_text()
    assert page.count('<img alt="') == 2
    sources = re.findall(r"""src=["'](.{0,22})""", page)
    assert sources == ["data:image/png;base64,"] * 2
    # The list of contents points into the page.
    assert {link[0] for link in re.findall(r"""href=["'](.)""", page)} == {"#"}
    assert not re.search(r"url\(|@import|<script|<link|<iframe", page)
    assert "PlantStatus" not in page
    for heading in ("Signals", "Latency and jitter", "Messages", "Lost and refused"):
        assert f"<h2>{heading}</h2>" in page


@pytest.mark.usefixtures("unrendered")
def test_a_name_in_a_log_cannot_become_part_of_the_page(tmp_path: Path) -> None:
    path = tmp_path / "a<script>.log"
    path.write_text("(1.0) <img/src=x> 123#11\n(1.1) c 123#11\n<script>alert(1)</script>\n")
    figures = written(tmp_path / "out", path)
    assert figures["channels"] == ["<img/src=x>", "c"]
    page = (tmp_path / "out" / "a<script>" / "report.html").read_text()
    assert "<script" not in page
    assert "<img/" not in page


@pytest.mark.usefixtures("unrendered")
def test_a_file_that_is_no_log_leaves_nothing_and_keeps_no_other_from_its_report(
    constant: Run, tmp_path: Path, capsys: Capture
) -> None:
    bad, gone, out = tmp_path / "bad.blf", tmp_path / "gone.log", tmp_path / "deep" / "out"
    bad.write_bytes(b"no log at all")
    assert main([str(bad), str(gone), "--out", str(out)]) == ExitStatus.SETTINGS
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    for line, path in zip(lines, (bad, gone), strict=True):
        assert line.startswith(f"steer-by-wire analyze: error: {path}: ")
    assert not out.parent.exists()
    assert main([str(bad), str(constant.log), "--out", str(out)]) == ExitStatus.SETTINGS
    reported = capsys.readouterr()
    assert str(bad) in reported.err
    assert "report: " in reported.out
    assert [path.name for path in out.iterdir()] == [constant.log.stem]
    assert (out / constant.log.stem / "report.html").exists()
    before = (out / constant.log.stem / "signals.csv").read_bytes()
    assert main([str(constant.log), "--channel", "none", "--out", str(out)]) == ExitStatus.SETTINGS
    assert (out / constant.log.stem / "signals.csv").read_bytes() == before


@pytest.mark.usefixtures("unrendered")
def test_its_json_is_the_file_and_its_folder_takes_no_other_log(
    constant: Run, varying: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path / "out")]
    assert main([str(constant.log), *out, "--json", "-"]) == ExitStatus.OK
    (folder,) = (tmp_path / "out").iterdir()
    before = (folder / "figures.json").read_text(encoding="utf-8")
    assert capsys.readouterr().out == before
    assert main([str(constant.log), *out]) == ExitStatus.OK  # again is no other
    assert constant.log.name == varying.log.name
    assert main([str(varying.log), *out]) == ExitStatus.SETTINGS
    assert f"--out {folder} has another run, whose source.txt differs" in capsys.readouterr().err
    assert (folder / "figures.json").read_text(encoding="utf-8") == before


@pytest.mark.usefixtures("unrendered")
def test_a_log_whose_name_is_no_text_has_a_report(constant: Run, tmp_path: Path) -> None:
    log = tmp_path / os.fsdecode(b"Fahrt\xff.log")
    log.write_bytes(constant.log.read_bytes())
    for _ in range(2):  # the second time its folder must know it again
        assert main([str(log), "--out", str(tmp_path / "out")]) == ExitStatus.OK
    assert (tmp_path / "out" / log.stem / "report.html").exists()
