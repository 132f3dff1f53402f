"""``dialect new`` makes a file that is read, ``dialect check`` says what is missing in one."""

import re
import shutil
from pathlib import Path
from typing import Any

import cantools.database
import pytest

from steer_by_wire.dbc.dialect.dialect import read_dialect
from steer_by_wire.dbc.dialect.settings import Quantity
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.tools.dialect import __main__ as program
from steer_by_wire.tools.dialect.__main__ import main
from steer_by_wire.tools.run.__main__ import main as run

CAR = Path(__file__).parents[2] / "dbc" / "dialect" / "my_car.toml"
DBC = CAR.with_suffix(".dbc")


def test_a_first_mapping_is_read_and_names_its_guesses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", str(DBC)]) == ExitStatus.OK
    text = capsys.readouterr().out
    file = Path(shutil.copy(DBC, tmp_path)).with_suffix(".toml")
    file.write_text(text, encoding="utf-8")
    guessed = {Quantity.STEER, Quantity.ENGAGED, Quantity.WHEEL_ANGLE, Quantity.SPEED}
    guessed |= {Quantity.YAW_RATE, Quantity.LATERAL_ERROR, Quantity.HEADING_ERROR}
    assert read_dialect(file).carried == guessed  # the last two in our own LATERAL_ERROR
    mapped = [line for line in text.splitlines() if re.match("signals|counter|# checksum", line)]
    assert len(mapped) == 9
    assert all("# guess: " in line for line in mapped)
    assert 'keep = ["LATERAL_ERROR"]  # ours: ' in text
    assert "cycle_ms = 10\n" in text  # of the database
    assert "cycle_ms = 20  # guess: not in the database" in text


def test_the_check_names_what_is_missing_and_leaves_a_minute_of_traffic(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert program.MOTION_S == 60.0
    monkeypatch.setattr(program, "MOTION_S", 10.0)
    file, log = tmp_path / "my_car.toml", tmp_path / "traffic.log"
    shutil.copy(DBC, tmp_path)
    text = CAR.read_text(encoding="utf-8")
    file.write_text(re.sub("signals.YAW_RATE .*\n", "", text), encoding="utf-8")
    assert main(["check", str(file), "--out", str(log)]) == ExitStatus.OK
    said = capsys.readouterr().out
    assert re.search(r"STEER_REQUEST 0x100 +controller +10 +REQUEST_COUNTER +sum ", said)
    assert re.findall("missing: (.*?):", said) == ["yaw_rate_rad_s"]
    assert re.search(r"plant emulator: \d+ frames sent, 100\d accepted, refused: none", said)
    lines = log.read_text(encoding="utf-8").splitlines()
    first_s, last_s = (float(lines[place].split(")")[0].strip("(")) for place in (0, -1))
    assert last_s - first_s == pytest.approx(10.0, abs=0.1)
    database: Any = cantools.database.load_file(DBC)
    names = {int(line.split()[2].partition("#")[0], 16) for line in lines}
    assert names == {message.frame_id for message in database.messages}


def test_a_run_says_what_its_gateways_did(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--dialect", str(CAR), "--duration", "2", "--preset", "practical_pd"]
    assert run(words) == ExitStatus.OK
    said = capsys.readouterr().out
    assert re.search(
        r"dialect +plant emulator: \d+ frames sent, 20\d accepted, refused: none", said
    )
    assert re.search(r"dialect +controller: 20\d frames sent, \d+ accepted, refused: none", said)


def test_a_law_that_reads_what_the_car_lacks_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(DBC, tmp_path)
    file = tmp_path / "my_car.toml"
    text = re.sub("signals.(YAW_RATE|CURVATURE) .*\n", "", CAR.read_text(encoding="utf-8"))
    file.write_text(text, encoding="utf-8")
    words = ["--dialect", str(file), "--preset", "practical_predictor", "--duration", "1"]
    assert run(words) == ExitStatus.SETTINGS
    assert capsys.readouterr().err == (
        "steer-by-wire run: error: --dialect: law predictor reads more than the lateral error, and"
        " no signal carries preview_curvature_1_m, yaw_rate_rad_s\n"
    )
    assert run([*words, "--law", "pd"]) == ExitStatus.OK
