"""The program ``steer-by-wire identify``."""

import json
import re
import signal
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop.identification.columns import read_columns
from steer_by_wire.plant_emulator.settings import PlantSettings, shared_vehicle
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.tools.identify import __main__ as program
from steer_by_wire.tools.identify.__main__ import main
from tests.support.runs.drawn_drives import drawn_car, log_of, prescribed


@cache
def table() -> str:
    """A drive as a CSV whose columns have names of ours."""
    rng = np.random.default_rng(5)
    car = drawn_car(rng)
    steering, speed = (one[4_000:24_000] for one in prescribed(car))
    channels = log_of(car, steering, speed, rng).channels[:3]
    columns = [channels[0].time_s, *(one.values for one in channels)]
    header = ",".join(("time_s", *(one.name for one in channels)))
    rows = (",".join(map("{:.6g}".format, row)) for row in zip(*columns, strict=True))
    return "\n".join((header, *rows))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    file = tmp_path / "drive.csv"
    file.write_text(table())
    return file


def test_a_drive_becomes_a_vehicle_that_predicts_it(log, tmp_path, capsys) -> None:
    out = tmp_path / "car"
    assert main([str(log), "--from", "5", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    partner = re.search(r"\nrear_stiffness_\w+ [^\n]* with (\w+)\n", shown)[1]
    assert re.search(rf"\nnext: tell by --known[^\n]* {partner}\n", shown)
    residual = float(re.search(r"residual of yaw rate: (\S+) %", shown)[1])
    vehicle = load_settings(PlantSettings, shared=shared_vehicle(out / "vehicle.toml")).vehicle
    tables = tomllib.loads((out / "vehicle.toml").read_text())
    assert vehicle.yaw_inertia_kg_m2 == tables["vehicle"]["yaw_inertia_kg_m2"]
    report = json.loads((out / "report.json").read_text())
    assert all(test["is_passed"] for test in report["tests"])
    assert report["residual_percent"] == pytest.approx(residual, abs=0.01)
    assert main([str(log), "--from", "5", "--predict", str(out / "vehicle.toml")]) == 0
    predicted = float(re.search(r"residual of yaw rate: (\S+) %", capsys.readouterr().out)[1])
    assert predicted == pytest.approx(residual, rel=0.02)


@pytest.mark.parametrize("phase", ["reading", "fit", "delays"])
def test_an_interrupt_keeps_what_is_known_so_far(log, tmp_path, capsys, monkeypatch, phase) -> None:
    shown, out = program._Progress.advance, tmp_path / "car"

    def interrupt(*_: object) -> None:
        signal.raise_signal(signal.SIGINT)

    def advance(progress, what: str, done: int, of: int) -> None:
        if what == phase and done == 3:
            interrupt()
        shown(progress, what, done, of)

    monkeypatch.setattr(program._Progress, "advance", advance)
    if phase == "reading":
        monkeypatch.setattr(program, "make_drive", interrupt)
    assert main([str(log), "--out", str(out)]) == ExitStatus.INTERRUPTED
    output = capsys.readouterr()
    files = sorted(file.name for file in out.glob("*"))
    if phase == "reading":
        assert "while the logs were read: no file is written" in output.err
        assert not files
    else:
        assert f"interrupted in {phase}: the best so far" in output.out
        last = output.out.splitlines()[-1].partition(": ")[2]
        assert sorted(last.split(", ")) == files
        for name in ("vehicle.toml", "actuator.toml"):
            assert f"interrupted in {phase}" in (out / name).read_text().partition("\n")[0]


def test_new_proposes_a_mapping_that_reads_the_log(log, capsys) -> None:
    _, plain, _ = read_columns(log)
    renamed = log.read_text().replace("hand_wheel_rad,speed_m_s", "SteerAngle,Speed_kmh", 1)
    log.write_text(renamed.replace("yaw_rate_rad_s", "YAW,yaw_rate_of_rack_deg_s", 1))
    assert main([str(log)]) == 2
    assert "has no hand_wheel_rad" in capsys.readouterr().err
    assert main(["new", str(log)]) == 0
    mapping = log.with_suffix(".toml")
    mapping.write_text(capsys.readouterr().out)
    columns = tomllib.loads(mapping.read_text())["columns"]
    assert columns["hand_wheel_rad"]["column"] == "steerangle"
    assert columns["yaw_rate_of_rack_deg_s"]["unit"] == "deg_s"
    assert "none found for wheel_angle_rad" not in mapping.read_text()
    _, speed, _ = read_columns(log, mapping)
    assert speed.values == pytest.approx(plain.values / 3.6)


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ("new", "name a LOG"),
        ("missing.csv", "missing.csv"),
        ("missing.csv --controller nix", "nix"),
        ("drive.csv --dialect early.toml", "leave it out"),
        ("drive.csv --known early.toml", "needs mass_kg"),
        ("drive.csv --known named.toml", "mass_kg"),
        ("drive.csv early.toml", "early.toml: is not a table of time series, but drive.csv"),
        ("drive.csv --from 5 --to 2", "no sample between --from and --to"),
    ],
)
def test_a_wrong_call_is_refused_in_one_line(log, monkeypatch, capsys, words, what) -> None:
    monkeypatch.chdir(log.parent)
    Path("early.toml").write_text("yaw_inertia_kg_m2 = 3000")
    Path("named.toml").write_text("mass = 1")
    assert main(words.split()) == 2
    error = capsys.readouterr().err
    assert what in error
    assert error.count("\n") == 1
