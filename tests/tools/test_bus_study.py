"""The study of the pair over its bus."""

import csv
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.program.program import ExitStatus
from steer_by_wire.tools.bus_study import __main__ as program
from steer_by_wire.tools.bus_study.__main__ import main
from steer_by_wire.tools.bus_study.runs import BusRun, Point, runs_of


def run_all(points: list[Point], duration_s: float) -> list[BusRun]:
    return list(runs_of(points, ["practical_pd"], BusSettings(), (1,), duration_s, lambda: False))


def test_errors_grow_with_their_rate_and_delay_without_losing() -> None:
    points = [Point(0.5, rate, 0.0) for rate in (0.0, 1e-4, 1e-3)]
    runs = run_all(points, 2.0)
    detected = [run.detected for run in runs]
    assert detected[0] == 0
    # 500 000 bit/s for two seconds, some 60 % of them in frames.
    assert 0.4 * 60 < detected[1] < 1.6 * 60
    assert 0.7 * 600 < detected[2] < 1.3 * 600
    assert all(run.verdict == "holds" for run in runs)
    assert runs[0].bus_load < runs[2].bus_load


def test_clocks_apart_move_the_phase_between_both_programs() -> None:
    points = [Point(0.0, 0.0, ppm) for ppm in (0.0, 2000.0)]
    together, apart = run_all(points, 5.0)
    # 2000 ppm move the phase by a period of 10 ms within 5 s.
    assert together.rms_m != apart.rms_m
    assert apart.verdict == "holds"


def test_it_prints_a_table_and_writes_every_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, picture = tmp_path / "runs.csv", tmp_path / "study.png"
    words = "--load 0.3 --bit-error-rate 1e-4 1e-3 --seeds 1 --duration 1 --controller-preset"
    written = ["practical_pd", "--csv", str(file), "--picture", str(picture)]
    assert main([*words.split(), *written]) == 0
    assert capsys.readouterr().out.count("practical_pd") == 2
    rows = list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))
    assert [row["bit_error_rate"] for row in rows] == ["0.0001", "0.001"]
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_an_unknown_preset_is_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--controller-preset", "fast"]) == 2
    assert "fast" in capsys.readouterr().err


def test_an_interrupted_study_keeps_the_runs_that_are_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The signal comes while the second run is under way."""

    def interrupted(*arguments: Any) -> Iterator[BusRun]:
        whole = runs_of(*arguments)
        yield next(whole)
        signal.raise_signal(signal.SIGINT)
        yield from whole

    monkeypatch.setattr(program, "runs_of", interrupted)
    file = tmp_path / "runs.csv"
    words = "--load 0 --bit-error-rate 1e-4 1e-3 --seeds 1 --duration 1 --controller-preset"
    status = main([*words.split(), "practical_pd", "--csv", str(file)])
    assert status == ExitStatus.INTERRUPTED
    assert "interrupted by SIGINT: 1 of 2 runs" in capsys.readouterr().out
    assert len(file.read_text(encoding="utf-8").splitlines()) == 2
    assert [one.name for one in tmp_path.iterdir()] == ["runs.csv"]
