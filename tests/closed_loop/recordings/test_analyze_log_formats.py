"""Every format of a log gives the same figures, also what candump prints."""

from pathlib import Path

import pytest

from steer_by_wire.closed_loop.recordings.log_analysis import CG_DEVIATION
from steer_by_wire.closed_loop.recordings.log_file import open_log
from steer_by_wire.closed_loop.recordings.logged import LogError, Logged
from steer_by_wire.runtime.frame import BITRATE_SWITCH, EXTENDED, FD, REMOTE, Frame
from tests.support.frames.recorded_frames import entries_in
from tests.support.runs.logged_run import analyse, convert, same_but_for_times, written
from tests.support.runs.logged_run import beginning as beginning
from tests.support.runs.logged_run import varying as varying
from tests.support.suite.unrendered import unrendered as unrendered

pytestmark = pytest.mark.usefixtures("unrendered")


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf", ".csv", ".trc"])
def test_every_format_of_python_can_gives_the_same_figures(
    beginning: Path, tmp_path: Path, suffix: str
) -> None:
    entries = entries_in(beginning)
    figures = analyse(convert(entries, tmp_path / f"converted{suffix}"))
    assert figures["frames"] == len(entries)
    same_but_for_times(analyse(beginning), figures)


@pytest.mark.parametrize("suffix", [".db", ".mf4"])
def test_a_log_of_another_format_is_to_be_converted(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(LogError, match=rf"a {suffix} is not read; convert it: .* run\.blf"):
        open_log(tmp_path / f"run{suffix}")


def plain(entry: Logged, stamp: str, marks: str = "") -> str:
    can_id, data, _ = entry.frame
    payload = " ".join(f"{byte:02X}" for byte in data)
    return f"{stamp}  vcan0  {marks}{can_id:03X}   [{len(data)}]  {payload}\n"


def test_without_times_there_are_counts_and_signals_only(beginning: Path, tmp_path: Path) -> None:
    path = tmp_path / "printed"
    path.write_text("".join(plain(entry, "") for entry in entries_in(beginning)))
    figures, known = written(tmp_path / "out", path), analyse(beginning)
    assert (figures["has_times"], figures["duration_s"]) == (False, None)
    assert figures["latency"]["round_trip"]["samples"] == 0
    for name in known["messages"]:
        assert figures["messages"][name]["missing"] == known["messages"][name]["missing"]
    assert figures["signals"].pop(CG_DEVIATION)["samples"] == 0
    for name, signal in figures["signals"].items():
        assert signal["rms"] == known["signals"][name]["rms"]
    report = (tmp_path / "out" / "printed" / "report.html").read_text()
    assert "no times" in report
    assert "<img" not in report


PRINTED_BY_CANDUMP = {
    "": """\
  vcan0  320   [7]  23 20 03 2C 01 64 00
  vcan0  00000123   [2]  AA BB
  vcan0       123   [0]  remote request
  vcan0       123  [03]  AA BB CC
  vcan0       125   [0]|
""",
    "-ta": """\
 (1795247554.828802)  vcan0  320   [7]  23 20 03 2C 01 64 00
 (1795247554.889178)  vcan0  00000123   [2]  AA BB
 (1795247554.900574)  vcan0       123   [0]  remote request
 (1795247554.912509)  vcan0       123  [03]  AA BB CC
 (1795247554.935603)  vcan0       125   [0]|
""",
    "-tA": """\
 (2026-11-21 07:52:37.863038)  vcan0  320   [7]  23 20 03 2C 01 64 00
 (2026-11-21 07:52:37.921220)  vcan0  00000123   [2]  AA BB
 (2026-11-21 07:52:37.931875)  vcan0       123   [0]  remote request
 (2026-11-21 07:52:37.948353)  vcan0       123  [03]  AA BB CC
 (2026-11-21 07:52:37.971020)  vcan0       125   [0]|
""",
    "-ta -x -a": """\
 (1795247554.828802)  vcan0  TX - -  320   [7]  23 20 03 2C 01 64 00      '# .,.d.'
 (1795247554.889178)  vcan0  TX - -  00000123   [2]  AA BB                     '..'
 (1795247554.900574)  vcan0  TX - -       123   [0]  remote request
 (1795247554.912509)  vcan0  TX B -       123  [03]  AA BB CC                  '...'
 (1795247554.935603)  vcan0  TX - -       125   [0]                            ''
""",
    "-L -x": """\
(1795247562.865360) vcan0 320#2320032C016400 T
(1795247562.955390) vcan0 00000123#AABB T
(1795247562.967117) vcan0 123#R T
(1795247562.978724) vcan0 123##5AABBCC T
(1795247563.011651) vcan0 125# T
""",
}
"""Copied from a terminal: candump of can-utils on a real vcan0; | is a blank at the end."""


@pytest.mark.parametrize("way", PRINTED_BY_CANDUMP)
def test_lines_of_a_real_candump_are_read(tmp_path: Path, way: str) -> None:
    path = tmp_path / "run.txt"
    path.write_text(PRINTED_BY_CANDUMP[way].replace("|", " "))
    log = open_log(path)
    logged = list(log)
    assert log.unreadable == 0
    flags = BITRATE_SWITCH if way in ("-L -x",) else 0
    assert [one.frame for one in logged] == [
        Frame(0x320, bytes.fromhex("2320032C016400")),
        Frame(0x123, b"\xaa\xbb", EXTENDED),
        Frame(0x123, b"", REMOTE),
        Frame(0x123, b"\xaa\xbb\xcc", FD | flags),
        Frame(0x125, b""),
    ]
    assert {one.channel for one in logged} == {"vcan0"}
    if way == "-ta":
        assert logged[0].time_ns == 1_795_247_554_828_802_000
    if way == "-tA":
        times = [one.time_ns for one in logged if one.time_ns is not None]
        assert times[-1] - times[0] == 107_982_000
