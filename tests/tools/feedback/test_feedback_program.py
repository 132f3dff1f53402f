"""The program ``steer-by-wire feedback``."""

import json
import re
from pathlib import Path

import pytest

from steer_by_wire.tools.feedback.__main__ import main
from steer_by_wire.tools.feedback.picture import both_ways_ms

ONE_LOOP = ("--torque-gradients", "6", "--speeds-km-h", "80")


def first_ms(path: Path, *options: str) -> dict[str, float]:
    assert main([*ONE_LOOP, "--json", str(path), *options]) == 0
    loops = json.loads(path.read_text())["loops"]
    return {row["grip"]: 1e3 * row["unstable"][0]["start_s"] for row in loops if row["unstable"]}


def test_damping_and_an_observer_let_the_wheel_bear_a_longer_round_trip(tmp_path: Path) -> None:
    plain = first_ms(tmp_path / "plain.json")
    assert list(plain) == ["hands_off", "loose"]  # the others never shake
    damped = first_ms(tmp_path / "damped.json", "--damping", "0.65")
    observed = first_ms(tmp_path / "cdob.json", "--cdob", "50")
    assert plain["hands_off"] < plain["loose"]
    assert 5 * plain["hands_off"] < damped["hands_off"] < observed["hands_off"]


def test_the_table_and_the_picture_show_both_kinds_of_tyres(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture, both = tmp_path / "p.png", tmp_path / "both.json"
    of_car = (*ONE_LOOP, "--preset", "bmw_320i")
    assert main([*of_car, "--plot", str(picture)]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "first unstable round trip [ms], bmw_320i, cycle 1 ms"
    names = [line.split()[:2] for line in printed[2:]]
    assert names[::2] == [["6", grip] for grip in ("hands", "loose", "light", "firm")]
    assert names[1::2] == [["tyres", "lag"]] * 4
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main([*of_car, "--json", str(both)]) == 0
    known = json.loads(both.read_text())
    assert known["loops_with_tyre_lag"] != known["loops"]


def test_the_picture_marks_how_long_both_frames_wait() -> None:
    # With its gap a frame takes 0.27 ms: STEERING_FORCE waits for 4, HAND_WHEEL_STATE for 6.
    assert both_ways_ms(0.01) == pytest.approx((2 * 0.264, 10 * 0.27), abs=1e-5)
    assert both_ways_ms(0.0005)[1] is None


def test_its_page_shows_what_it_prints(capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).parents[3] / "docs" / "feedback.md").read_text(encoding="utf-8")
    commands, block, *_ = re.findall(r"```(?:sh|text)\n(.*?)```", page, re.DOTALL)
    for command in commands.splitlines():
        assert main(command.split()[2:]) == 0
    printed = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert printed == block.splitlines()


def test_jitter_is_shown_at_each_round_trip(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*ONE_LOOP, "--lag-ms", "10", "--jitter-at", "4,10"]) == 0
    assert "tolerated jitter [ms] above a round trip of 10 ms" in capsys.readouterr().out
    assert main([*ONE_LOOP, "--jitter-at", "4,10", "--json", str(tmp_path / "loops.json")]) == 0
    loops = json.loads((tmp_path / "loops.json").read_text())["loops"]
    for row in loops:
        near, far = row["jitter_s"]
        assert near > far > 0.0
