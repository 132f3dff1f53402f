"""The program ``steer-by-wire can response-times``."""

import json
from pathlib import Path

import pytest

from steer_by_wire.tools.can.__main__ import main

RESPONSE_TIMES = "response-times"
OURS = str(Path(__file__).parents[3] / "dbc" / "steer_by_wire.dbc")

BUSY = """VERSION ""
BU_: A
BO_ 16 FAST: 8 A
 SG_ x : 0|8@1+ (1,0) [0|0] "" A
BO_ 32 SLOW: 8 A
 SG_ y : 0|8@1+ (1,0) [0|0] "" A
"""

LONG = """VERSION ""
BU_: A
BO_ 2566834711 DM1: 39 A
BO_ 2565865751 CI: 100 A
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 100000;
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "J1939PG";
BA_ "GenMsgCycleTime" BO_ 2566834711 1000;
BA_ "GenMsgCycleTime" BO_ 2565865751 5000;
"""


def test_messages_without_a_cycle_are_named_and_the_load_is_said(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([RESPONSE_TIMES, OURS, "--bitrate", "125000"]) == 0
    printed = capsys.readouterr()
    assert "LATENCY_CONFIG" in printed.err
    assert "STEERING_COMMAND" in printed.out
    assert printed.out.splitlines()[-1].startswith("bus load: ")


def test_jitter_may_release_more_than_a_thousand_frames_at_once(tmp_path: Path) -> None:
    busy, file = tmp_path / "busy.dbc", tmp_path / "out.json"
    busy.write_text(BUSY)
    words = [str(busy), "--period", "FAST=1", "--jitter-ms", "2000", "--json", str(file)]
    assert main([RESPONSE_TIMES, *words]) == 0
    (message,) = json.loads(file.read_text())["messages"]
    assert message["bound_ns"] == 2_000_000_000 + message["frame_ns"]


def test_long_j1939_messages_are_left_out_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    long = tmp_path / "long.dbc"
    long.write_text(LONG)
    assert main([RESPONSE_TIMES, str(long), OURS]) == 0
    assert "left out, as they need several frames: DM1, CI\n" in capsys.readouterr().err


def test_an_overloaded_bus_has_no_bound(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    busy = tmp_path / "busy.dbc"
    busy.write_text(BUSY)
    words = [str(busy), "--period", "FAST=0.2", "--period", "SLOW=10", "--bitrate", "500000"]
    assert main([RESPONSE_TIMES, *words]) == 0
    assert "no bound" in capsys.readouterr().out
