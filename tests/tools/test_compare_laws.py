"""The comparison of the laws, and the designed predictors: what they say is measured anew."""

import os
import re
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from types import FrameType

import numpy as np
import pytest

from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.runtime.program.program import ExitStatus, StopRequest
from steer_by_wire.runtime.settings import load_settings, read_preset
from steer_by_wire.tools.compare_laws import runs
from steer_by_wire.tools.compare_laws.__main__ import (
    PREDICTORS,
    interior_line,
    interior_points,
    main,
)
from steer_by_wire.tools.compare_laws.presentation import (
    draw_break_points,
    draw_comparison,
    markdown_lines,
    table_lines,
)
from steer_by_wire.tools.compare_laws.runs import OFF_PATH_M, Cell, breaks_at_s, compare
from steer_by_wire.tools.design.predictor import describe_predictor
from steer_by_wire.tools.design.predictor_runs import Task
from steer_by_wire.tools.design.report import predictor_figures
from steer_by_wire.tools.design.specification import Specification
from steer_by_wire.tools.design.vehicle_file import VehicleFile

GAIN_DESIGN = Path(__file__).parents[2] / "tools" / "design"


@pytest.mark.parametrize(
    ("preset", "vehicle", "specification"),
    [
        ("practical_predictor", "paper_vehicle", "practical_predictor"),
        ("highway_predictor", "highway_vehicle", "highway"),
    ],
)
def test_a_designed_predictor_says_what_is_measured_anew(
    preset: str, vehicle: str, specification: str
) -> None:
    text = read_preset("steer_by_wire.controller.presets", preset)
    settings = load_settings(ControllerSettings, text)
    spec = load_settings(Specification, None, GAIN_DESIGN / f"{specification}.toml")
    box = load_settings(VehicleFile, None, GAIN_DESIGN / f"{vehicle}.toml")
    assert spec.predictor is not None
    with ThreadPoolExecutor(2) as pool:
        design = describe_predictor(Task(pool, spec, spec.predictor, box), settings)
    said = re.findall(
        r"^#   (RMS error|jitter|noise|peak sensitivity|largest error|without echoes) +(.*)$",
        text.text,
        re.MULTILINE,
    )
    assert said == list(predictor_figures(spec, spec.predictor, design))


def test_inside_the_box_the_predictor_holds_the_car_itself_on_the_path() -> None:
    _, follows_cg = PREDICTORS
    points = interior_points(16, 60.0, follows_cg)
    assert {one.delay_s > 0.25 for one in points} == {True, False}
    assert 1e-4 < points[-1].cg_rms_m <= points[0].cg_rms_m < 8e-3
    assert "16 points inside the box" in interior_line(follows_cg, points)


def test_the_predictor_holds_half_a_second_and_the_observers_do_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    chosen = tuple(
        one for one in runs.CONTESTANTS if one.label in ("PD+DDOB", "predictor", "predictor, CG")
    )
    monkeypatch.setattr(runs, "CONTESTANTS", chosen)
    reported: list[tuple[int, int]] = []
    cells = compare([0.0, 0.5], 1, 20.0, lambda done, of: reported.append((done, of)))
    assert reported[-1] == (30, 30)
    worst = {(cell.contestant, cell.network, cell.delay_s): cell.settled_rms_m for cell in cells}
    for network in ("constant", "jitter", "in_order", "loss"):
        assert worst["predictor", network, 0.5] < 0.003
    assert worst["PD+DDOB", "constant", 0.5] > 0.1
    of_cg = {(cell.contestant, cell.network, cell.delay_s): cell.settled_cg_rms_m for cell in cells}
    assert of_cg["predictor", "constant", 0.5] > 0.05
    assert 1e-4 < of_cg["predictor, CG", "constant", 0.5] < 0.004
    assert worst["predictor", "lag", 0.5] < 0.02
    # Newest wins, what acts is younger than the mean, and hides what jitter does in order.
    assert worst["PD+DDOB", "jitter", 0.5] < 0.01
    assert worst["PD+DDOB", "in_order", 0.5] > 0.1
    lines = table_lines(cells)
    assert any(line.startswith("PD+DDOB") and line.endswith("500 ms") for line in lines)
    assert any(line.startswith("predictor") and line.endswith("-") for line in lines)
    assert "| PD+DDOB | 500 | - | 500 | 500 | 500 |" in markdown_lines(cells)
    assert len(draw_comparison(cells).axes) == 6
    (legend,) = draw_break_points(cells).legends
    told_of = [text.get_text() for text in legend.get_texts()]
    assert "PD+DDOB: breaks at 500 ms" in told_of
    assert "predictor: holds throughout" in told_of


def test_a_published_law_breaks_at_80_ms_where_it_has_its_own_rate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    published = next(one for one in runs.CONTESTANTS if one.label == "PD as published")
    monkeypatch.setattr(runs, "CONTESTANTS", (published,))
    assert runs.contestants_of(runs.NETWORKS["constant"]) == [published]
    assert runs.contestants_of(runs.NETWORKS["jitter"]) == []
    without, with_80_ms = compare([0.0, 0.08], 1, 60.0, lambda *_counts: None)
    assert without.settled_rms_m < runs.BROKEN_M < with_80_ms.settled_rms_m


def test_a_law_breaks_at_the_first_delay_at_which_it_does_not_hold_the_path() -> None:
    cells = [
        Cell("law", "constant", delay_s, follows_cg, rms_m, rms_m, cg_m, cg_m)
        for delay_s, error_m in ((0.0, 0.1), (0.1, 0.1001), (0.2, 0.01), (0.3, OFF_PATH_M))
        for follows_cg, rms_m, cg_m in ((False, error_m, 1.0), (True, 1.0, error_m))
    ]
    assert breaks_at_s(cells) == 0.1
    assert breaks_at_s(cells[:2]) is None
    assert np.isfinite(cells[0].rms_m)


def test_ctrl_c_ends_the_comparison_soon_and_leaves_what_is_complete(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    interrupted, cancelled = Event(), Event()
    take_signal = StopRequest._take_signal
    computed = []

    class Pool(ThreadPoolExecutor):
        def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
            super().shutdown(False, cancel_futures=cancel_futures)
            cancelled.set()
            super().shutdown(wait)

    def taken(stop: StopRequest, number: int, frame: FrameType | None) -> None:
        take_signal(stop, number, frame)
        interrupted.set()

    def cell(key: str, one: runs.Contestant, delay_s: float, *_further: object) -> Cell:
        computed.append(delay_s)
        if len(computed) == 1:
            os.kill(os.getpid(), signal.SIGINT)
            assert interrupted.wait(60.0)
        else:
            assert cancelled.wait(60.0)
        return Cell(one.label, key, delay_s, False, 0.01, 0.01, 0.01, 0.01)

    monkeypatch.setattr(runs, "ThreadPoolExecutor", Pool)
    monkeypatch.setattr(runs, "cell_of", cell)
    monkeypatch.setattr(StopRequest, "_take_signal", taken)
    assert main(["--out", str(tmp_path)]) == ExitStatus.INTERRUPTED
    assert len(computed) <= 1 + 2 * runs.THREADS  # of 1525
    header, *rows = (tmp_path / "comparison.csv").read_text(encoding="utf-8").splitlines()
    assert header.startswith("contestant,network,")
    assert f"interrupted: {len(rows)} results are in" in capsys.readouterr().out
    assert rows
