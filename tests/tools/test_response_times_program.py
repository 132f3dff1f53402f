"""The program ``steer-by-wire response-times``."""

import json
from pathlib import Path

import pytest

from steer_by_wire.tools.response_times.__main__ import main

OURS = str(Path(__file__).parents[2] / "dbc" / "steer_by_wire.dbc")

BUSY = """VERSION ""
BU_: A
BO_ 16 FAST: 8 A
 SG_ x : 0|8@1+ (1,0) [0|0] "" A
BO_ 32 SLOW: 8 A
 SG_ y : 0|8@1+ (1,0) [0|0] "" A
"""


def test_every_message_has_its_bound_beside_the_simulation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "out.json"
    words = [OURS, "--bitrate", "125000", "--preset", "paper_pd", "--json", str(file)]
    assert main(words) == 0
    printed = capsys.readouterr()
    assert "LATENCY_CONFIG" in printed.err
    assert "STEERING_COMMAND" in printed.out
    record = json.loads(file.read_text())
    for message in record["messages"]:
        assert message["random_ns"] <= message["critical_ns"] <= message["bound_ns"]
    command, error = record["messages"][:2]
    assert record["steering"]["most_ns"] == command["bound_ns"] + error["bound_ns"]


def test_faster_traffic_above_the_steering_breaks_the_published_gains_at_some_load(
    tmp_path: Path,
) -> None:
    busy, file = tmp_path / "busy.dbc", tmp_path / "out.json"
    busy.write_text(BUSY)
    words = [OURS, str(busy), "--period", "FAST=5", "--period", "SLOW=5", "--json", str(file)]
    assert main([*words, "--preset", "paper_pd"]) == 0
    (tolerance,) = json.loads(file.read_text())["steering"]["tolerances"]
    assert 0.5 < tolerance["load_max"] < 1.0


def test_a_set_without_the_steering_has_bounds_alone(tmp_path: Path) -> None:
    busy, file = tmp_path / "busy.dbc", tmp_path / "out.json"
    busy.write_text(BUSY)
    assert main([str(busy), "--period", "FAST=1", "--json", str(file)]) == 0
    record = json.loads(file.read_text())
    assert record["steering"] is None
    assert [message["name"] for message in record["messages"]] == ["FAST"]


def test_an_overloaded_bus_has_no_bound_and_is_not_simulated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    busy = tmp_path / "busy.dbc"
    busy.write_text(BUSY)
    words = [str(busy), "--period", "FAST=0.2", "--period", "SLOW=10", "--bitrate", "500000"]
    assert main(words) == 0
    assert "no bound" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nosuch.dbc"], "nosuch.dbc"),
        ([OURS, OURS], "the same identifier"),
        ([OURS, "--period", "NOSUCH=1"], "--period NOSUCH=1"),
        ([OURS, "--period", "LATENCY_CONFIG=0"], "0.1 to 3600000"),
        ([OURS, "--preset", "practical_predictor"], "steer-by-wire check"),
        ([OURS, "--preset", "nosuch"], "nosuch"),
    ],
)
def test_a_mistake_is_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    lines = capsys.readouterr().err.splitlines()
    last = lines[-1]
    assert all(line.startswith("steer-by-wire response-times: ") for line in lines)
    assert last.startswith("steer-by-wire response-times: error: ")
    assert said in last
