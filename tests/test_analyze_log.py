"""Figures out of a log: against the run it was taken from, in every format, and in spite of damage.

The log is one of a run in virtual time, so what is to come out is known from the plant's own
report, or by hand.
"""

import csv
import json
import math
import re
from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.settings import ControllerSettings
from dbc.messages import LateralError, Mode, SteeringCommand, encode
from plant_emulator.latency_settings import BothLatencySettings, LatencySettings
from plant_emulator.settings import PlantSettings
from runtime.candump import CandumpReader, LogEntry, format_entry
from runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from runtime.message import message_of
from runtime.program import ExitStatus
from runtime.settings import load_settings, read_preset
from tools.analyze_log import main
from tools.live_pair import PairResult
from tools.log_analysis.candump_text import Logged
from tools.log_analysis.durations import History
from tools.log_analysis.file_analysis import analyse_files
from tools.log_analysis.log_file import LogError, open_log
from tools.log_analysis.sensing_times import relative_uplink
from tools.virtual_pair import run_virtual_pair

Capture = pytest.CaptureFixture[str]
DURATION_S = 12.0
PERIOD_S = 0.01
DOWNLINK_S, UPLINK_S = 0.08, 0.02
SPREAD_S = 0.003
"""So small against the period that hardly a measurement overtakes another."""
START_NS = 1_700_000_000_123_456_000
"""What virtual time is told to begin at, where a format wants a date."""
ON_THE_WIRE_S = 1.5e-3
"""More than the frames of one instant take on the bus of virtual time."""
NEEDS_ASAMMDF = pytest.mark.skipif(
    find_spec("asammdf") is None, reason="asammdf is not installed (the extra mf4)"
)
NEEDS_PYARROW = pytest.mark.skipif(
    find_spec("pyarrow") is None, reason="pyarrow is not installed (the extra parquet)"
)
NEEDS_MCAP = pytest.mark.skipif(
    find_spec("mcap") is None, reason="mcap is not installed (the extra mcap)"
)
CONTROLLER = load_settings(ControllerSettings, read_preset("controller.presets", "practical_pd"))


class Run(NamedTuple):
    log: Path
    result: PairResult


def drive(log: Path, downlink: LatencySettings, uplink: LatencySettings) -> Run:
    plant = PlantSettings(
        duration_s=DURATION_S, latency=BothLatencySettings(downlink=downlink, uplink=uplink)
    )
    return Run(log, run_virtual_pair(plant, CONTROLLER, candump_log=log))


@pytest.fixture(scope="module")
def constant(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return a run with latencies that do not vary."""
    log = tmp_path_factory.mktemp("constant") / "run.log"
    return drive(log, LatencySettings(mean_s=DOWNLINK_S), LatencySettings(mean_s=UPLINK_S))


@pytest.fixture(scope="module")
def varying(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return a run with jitter and loss in both directions."""
    log = tmp_path_factory.mktemp("varying") / "run.log"
    return drive(
        log,
        LatencySettings(model="normal", mean_s=DOWNLINK_S, spread_s=0.02, loss=0.02),
        LatencySettings(model="normal", mean_s=0.04, spread_s=SPREAD_S, loss=0.05),
    )


def analyse(*paths: Path) -> dict[str, Any]:
    """Return the figures as they would be written."""
    figures: dict[str, Any] = json.loads(json.dumps(analyse_files(paths).figures))
    return figures


def written(out: Path, *arguments: Path | str) -> dict[str, Any]:
    """Run the program; returns the figures it has written."""
    assert main([*map(str, arguments), "--out", str(out)]) == ExitStatus.OK
    (path,) = out.rglob("figures.json")
    figures: dict[str, Any] = json.loads(path.read_text())
    return figures


def entries_of(log: Path) -> list[LogEntry]:
    with log.open(encoding="ascii") as lines:
        return list(CandumpReader(lines))


def write_log(path: Path, entries: Iterable[LogEntry]) -> Path:
    path.write_text("".join(format_entry(entry) + "\n" for entry in entries), encoding="ascii")
    return path


def is_of(entry: LogEntry, name: str) -> bool:
    return entry.frame.can_id == {"LATERAL_ERROR": 0x110, "STEERING_COMMAND": 0x100}[name]


# Figures against the run itself


def test_signals_have_the_rms_and_peak_of_the_run(constant: Run) -> None:
    figures = analyse(constant.log)
    trace, node = constant.result.trace, constant.result.plant["node"]
    error = figures["signals"]["lateral_error_m"]
    # It has the samples before the motion too, and ends before the last have left the uplink.
    assert error["samples"] == pytest.approx(node["samples"], abs=5)
    assert error["rms"] == pytest.approx(node["lateral_error_rms_m"], rel=3e-3)
    assert abs(error["peak"]) == pytest.approx(node["lateral_error_peak_m"], abs=5e-6)
    entries = entries_of(constant.log)
    command = next(entry for entry in entries if is_of(entry, "STEERING_COMMAND"))
    start_s = 1e-9 * (command.time_ns - entries[0].time_ns)  # motion starts with it
    at_s = error["peak_at_s"] - UPLINK_S - start_s
    assert np.interp(at_s, trace.time_s, trace.lateral_error_m) == pytest.approx(
        error["peak"], abs=1e-5
    )
    wheel = figures["signals"]["wheel_angle_rad"]
    assert abs(wheel["peak"]) == pytest.approx(node["wheel_angle_peak_rad"], abs=1e-5)


def test_a_latency_that_does_not_vary_comes_out_in_both_directions(constant: Run) -> None:
    latency = analyse(constant.log)["latency"]
    assert latency["is_absolute"] is True
    assert latency["uplink"]["p50_s"] == pytest.approx(UPLINK_S, abs=5e-4)
    assert latency["uplink"]["jitter_s"] < ON_THE_WIRE_S / 2
    for direction, least_s in (("downlink", DOWNLINK_S), ("round_trip", DOWNLINK_S + UPLINK_S)):
        # The next sample comes within a period.
        assert latency[direction]["min_s"] >= least_s - ON_THE_WIRE_S
        assert latency[direction]["max_s"] <= least_s + PERIOD_S + ON_THE_WIRE_S
    assert latency["told_downlink"]["p50_s"] == pytest.approx(DOWNLINK_S, abs=5e-4)
    assert latency["told_uplink"]["p50_s"] == pytest.approx(UPLINK_S, abs=5e-4)
    on_their_way = (DOWNLINK_S + UPLINK_S) / PERIOD_S + 2
    assert 0 <= latency["commands"] - latency["commands_seen_to_act"] <= on_their_way


def test_jitter_comes_out_in_both_directions(varying: Run) -> None:
    latency = analyse(varying.log)["latency"]
    node = varying.result.plant["node"]
    uplink, downlink = node["uplink"]["latency"], node["downlink"]["latency"]
    # The plant tells its latency 120 times, so the median of what it told is that far off.
    told_s = 3 * SPREAD_S / math.sqrt(120)
    for key in ("mean_s", "p50_s", "p99_s"):
        assert latency["uplink"][key] == pytest.approx(uplink[key], abs=told_s + ON_THE_WIRE_S)
    assert latency["uplink"]["jitter_s"] == pytest.approx(SPREAD_S, rel=0.15)
    # In the log a command acts when a sample sees it, less than a period later.
    later_s = latency["downlink"]["mean_s"] - downlink["mean_s"]
    assert -told_s < later_s < PERIOD_S + told_s


def test_the_round_trip_is_the_one_that_the_controller_measured(varying: Run) -> None:
    measured = analyse(varying.log)["latency"]["round_trip"]
    known = varying.result.controller["node"]["round_trip"]
    assert measured["samples"] == known["samples"]
    for key in ("mean_s", "p50_s", "p99_s", "max_s"):
        assert measured[key] == pytest.approx(known[key], rel=0.01, abs=1e-3)


def test_without_the_plants_word_the_uplink_counts_from_its_fastest_frame(
    constant: Run, tmp_path: Path
) -> None:
    entries = [e for e in entries_of(constant.log) if e.frame.can_id != 0x310]
    latency = analyse(write_log(tmp_path / "short.log", entries))["latency"]
    assert latency["is_absolute"] is False
    assert latency["uplink"]["p50_s"] < ON_THE_WIRE_S
    assert latency["downlink"]["p50_s"] == pytest.approx(
        latency["round_trip"]["p50_s"], abs=ON_THE_WIRE_S
    )


def test_counters_that_are_missing_are_what_the_uplink_lost_or_overtook(varying: Run) -> None:
    figures = analyse(varying.log)
    uplink = varying.result.plant["node"]["uplink"]
    missing = sum(figures["messages"][name]["missing"] for name in figures["messages"])
    # What was lost at the very end leaves no gap.
    assert missing == pytest.approx(uplink["lost"] + uplink["superseded"], abs=8)
    assert figures["plant_lost"] == pytest.approx(
        uplink["lost"] + varying.result.plant["node"]["downlink"]["lost"], abs=3
    )


def test_cycle_times_are_those_of_the_dbc(constant: Run) -> None:
    messages = analyse(constant.log)["messages"]
    assert messages["LATENCY_CONFIG"]["cycle_dbc_s"] is None
    for name, message in messages.items():
        if name != "LATENCY_CONFIG":
            cycle = message["cycle"]
            assert cycle["samples"] == message["accepted"] - 1
            # A quantile is within 0.4 % by its bin, and other frames take their time on the bus.
            assert cycle["p50_s"] == pytest.approx(message["cycle_dbc_s"], rel=4e-3, abs=5e-4)
            assert cycle["max_s"] < message["cycle_dbc_s"] + ON_THE_WIRE_S
            assert message["gaps"] == 0


def test_modes_and_law_are_told(constant: Run) -> None:
    figures = analyse(constant.log)
    assert figures["laws"] == ["PD"]
    assert sum(figures["modes_s"].values()) == pytest.approx(figures["duration_s"], abs=0.15)
    assert figures["modes_s"]["ACTIVE"] > 0.9 * DURATION_S


@given(
    st.lists(st.tuples(st.integers(20, 150), st.integers(1, 20)), min_size=1, max_size=6),
    st.integers(0, 2**32 - 1),
)
def test_samples_that_the_plant_skipped_do_not_look_like_latency(
    stalls: list[tuple[int, int]], seed: int
) -> None:
    period_ns = 10_000_000
    steps = [1 + skipped for samples, skipped in stalls for skipped in [*[0] * samples, skipped]]
    sensed = np.cumsum([*[1] * 20, *steps, *[1] * 20])
    jitter_ns = np.random.default_rng(seed).uniform(0.0, 1e6, sensed.size)
    arrivals_ns = sensed * period_ns + jitter_ns
    silences_ns = np.diff(arrivals_ns, prepend=arrivals_ns[0])
    uplink = relative_uplink(np.arange(sensed.size), arrivals_ns, silences_ns)
    assert uplink.skipped == sum(skipped for _, skipped in stalls)
    np.testing.assert_allclose(uplink.latency_ns, jitter_ns - jitter_ns.min(), atol=1.0)


def test_jitter_does_not_look_like_samples_that_the_plant_skipped() -> None:
    random = np.random.default_rng(3)
    number = np.arange(1000)
    arrivals_ns = np.sort(number * 1e7 + random.normal(40e6, 8e6, number.size))
    silences_ns = np.diff(arrivals_ns, prepend=arrivals_ns[0])
    uplink = relative_uplink(number, arrivals_ns, silences_ns)
    assert uplink.skipped == 0


@pytest.mark.parametrize("period_ns", [1_000_000, 5_000_000, 20_000_000, 33_333_000])
def test_another_sensing_period_than_the_dbcs_is_found(period_ns: int) -> None:
    number = np.arange(500)
    arrivals_ns = number * float(period_ns) + 5e6 * (number % 7 == 0)
    silences_ns = np.diff(arrivals_ns, prepend=arrivals_ns[0])
    uplink = relative_uplink(number, arrivals_ns, silences_ns)
    assert uplink.skipped == 0
    np.testing.assert_allclose(uplink.latency_ns, 5e6 * (number % 7 == 0), atol=1.0)


# Every format


def convert(entries: Sequence[LogEntry], path: Path) -> Path:
    with can.Logger(path) as writer:
        for time_ns, channel, frame in entries:
            message = message_of(frame)
            message.timestamp = (START_NS + time_ns) * 1e-9
            message.channel = channel
            writer.on_message_received(message)
        if isinstance(writer, can.SqliteWriter):
            while writer.num_frames < len(entries):
                pass  # its thread would leave the last batches out
    return path


def same_but_for_times(one: Any, other: Any, key: str = "") -> None:
    """Demand equal figures; times may differ by what formats round them to."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for name in one:
            if name not in ("files", "channels", "start"):
                same_but_for_times(one[name], other[name], name)
    elif isinstance(one, list):
        assert len(one) == len(other), key
        for left, right in zip(one, other, strict=True):
            same_but_for_times(left, right, key)
    elif isinstance(one, float):
        # A quantile is the middle of a bin, 0.8 % wide, and rounding may decide which.
        assert other == pytest.approx(one, rel=8e-3 if key.startswith("p") else 1e-6, abs=3e-6), key
    else:
        assert one == other, key


@pytest.mark.parametrize(
    "suffix",
    [".log", ".asc", ".blf", ".csv", ".db", ".trc", pytest.param(".mf4", marks=NEEDS_ASAMMDF)],
)
def test_every_format_of_python_can_gives_the_same_figures(
    varying: Run, tmp_path: Path, suffix: str
) -> None:
    entries = entries_of(varying.log)
    figures = analyse(convert(entries, tmp_path / f"converted{suffix}"))
    assert figures["frames"] == len(entries)
    same_but_for_times(analyse(varying.log), figures)


def plain(entry: LogEntry, stamp: str, marks: str = "") -> str:
    can_id, data, _ = entry.frame
    payload = " ".join(f"{byte:02X}" for byte in data)
    return f"{stamp}  vcan0  {marks}{can_id:03X}   [{len(data)}]  {payload}\n"


def seconds(time_ns: int) -> str:
    return f"{time_ns // 1_000_000_000:03}.{time_ns // 1000 % 1_000_000:06}"


@pytest.mark.parametrize("way", ["-ta", "-tz", "-td", "-td -x"])
def test_what_candump_prints_gives_the_same_figures(varying: Run, tmp_path: Path, way: str) -> None:
    entries = entries_of(varying.log)
    lines = []
    before_ns = entries[0].time_ns
    for entry in entries:
        time_ns = {
            "-ta": START_NS + entry.time_ns,
            "-tz": entry.time_ns - entries[0].time_ns,
        }.get(way, entry.time_ns - before_ns)
        before_ns = entry.time_ns
        marks = "RX - -  " if "-x" in way else ""
        lines.append(plain(entry, f" ({seconds(time_ns)})", marks))
    path = tmp_path / "printed.txt"
    path.write_text("".join(lines))
    figures = analyse(path)
    assert figures["unreadable"] == 0
    same_but_for_times(analyse(varying.log), figures)


def test_without_times_there_are_counts_and_signals_only(varying: Run, tmp_path: Path) -> None:
    path = tmp_path / "printed"
    path.write_text("".join(plain(entry, "") for entry in entries_of(varying.log)))
    figures, known = written(tmp_path / "out", path), analyse(varying.log)
    assert (figures["has_times"], figures["duration_s"]) == (False, None)
    assert figures["latency"]["round_trip"]["samples"] == 0
    for name in known["messages"]:
        assert figures["messages"][name]["missing"] == known["messages"][name]["missing"]
    for name, signal in known["signals"].items():
        assert figures["signals"][name]["rms"] == signal["rms"]
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
    "-td -x -a": """\
 (000.000000)  vcan0  TX - -  320   [7]  23 20 03 2C 01 64 00      '# .,.d.'
 (000.011188)  vcan0  TX - -  00000123   [2]  AA BB                     '..'
 (000.010480)  vcan0  TX - -       123   [0]  remote request
 (000.012160)  vcan0  TX B -       123  [03]  AA BB CC                  '...'
 (000.011108)  vcan0  TX - -       125   [0]                            ''
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
    if way == "-td -x -a":
        assert [one.time_ns for one in logged] == [0, 11188000, 21668000, 33828000, 44936000]
    if way == "-tA":
        times = [one.time_ns for one in logged if one.time_ns is not None]
        assert times[-1] - times[0] == 107_982_000


def test_error_frames_are_told_apart(tmp_path: Path) -> None:
    path = tmp_path / "run.txt"
    path.write_text(
        "  vcan0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME\n"
        "(1.0) vcan0 20000040#0000000000000000\n"
    )
    assert [one.frame.flags for one in open_log(path)] == [ERROR, ERROR]
    assert analyse(path)["error_frames"] == 2


# Damage


def damaged(lines: list[str], position: int, text: str) -> str:
    return "".join([*lines[:position], text + "\n", *lines[position:]])


@pytest.mark.parametrize(
    ("suffix", "position", "line"),
    [
        (".log", 7, "(0000000000.06 vcan0 110#00"),
        (".asc", 12, " 0.0600 1  110             Rx   d 8 ZZ 00 00 00 00 00 00 00"),
        (".csv", 7, "0.06,0x110,0,0,0,8"),
        (".trc", 25, "     12         60.000 DT  1     0110 Rx -  8    ZZ 00 00 00 00 00 00 00"),
    ],
)
def test_a_damaged_line_is_counted_and_told_and_costs_no_other(
    varying: Run, tmp_path: Path, suffix: str, position: int, line: str
) -> None:
    whole = convert(entries_of(varying.log), tmp_path / f"whole{suffix}")
    lines = whole.read_text().splitlines(keepends=True)
    path = tmp_path / f"damaged{suffix}"
    path.write_text(damaged(lines, position, line))
    figures = analyse(path)
    assert figures["unreadable"] == 1
    assert figures["first_unreadable"].startswith(f"{path}:{position + 1}: no frame")
    same_but_for_times(analyse(whole), {**figures, "unreadable": 0, "first_unreadable": ""})


def test_a_file_that_ends_in_the_middle_of_a_frame_is_read_up_to_there(
    varying: Run, tmp_path: Path
) -> None:
    entries = entries_of(varying.log)
    for suffix in (".log", ".blf", ".trc", ".asc", ".csv"):
        content = convert(entries, tmp_path / f"whole{suffix}").read_bytes()
        path = tmp_path / f"cut{suffix}"
        path.write_bytes(content[: len(content) // 2 + 7])
        assert 0.2 * len(entries) < analyse(path)["frames"] < 0.8 * len(entries)


@pytest.mark.parametrize(
    ("name", "content", "line"),
    [
        ("empty.log", b"", "{path}: there is no frame in it"),
        ("words.log", b"\nonce upon a time\n", "{path}:2: no frame: 'once upon a time'"),
        ("table.csv", b"time_s,message\n1.0,X\n", "{path}:2: no frame: "),
        ("head.trc", b";$FILEVERSION=2.1\n", "{path}:1: no frame: "),
        ("noise.blf", b"LOGG" + bytes(10), "{path}: no .blf file: "),
        ("noise.db", b"no database at all, but long enough", "{path}: damaged after 0 frames: "),
        ("noise.log.gz", b"no gzip", "{path}: Not a gzipped file"),
    ],
)
def test_a_file_without_a_frame_is_one_clear_line(
    tmp_path: Path, capsys: Capture, name: str, content: bytes, line: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    assert main([str(path), "--out", str(tmp_path / "out")]) == ExitStatus.SETTINGS
    (error,) = capsys.readouterr().err.splitlines()
    assert error.startswith(f"analyze_log: error: {line.format(path=path)}")


def test_a_file_that_is_not_there_is_one_clear_line(tmp_path: Path, capsys: Capture) -> None:
    for name in ("nothing.log", "nothing.db", "nothing.blf"):
        path = tmp_path / name
        assert main([str(path), "--out", str(tmp_path / "out")]) == ExitStatus.SETTINGS
        assert capsys.readouterr().err == f"analyze_log: error: {path}: No such file or directory\n"
        assert not path.exists()


@given(
    st.lists(
        st.one_of(
            st.text(max_size=30), st.sampled_from(["(1.0) c 123#11", "(1) c", "  c  1 [1] "])
        ),
        max_size=8,
    )
)
def test_no_text_makes_the_reader_raise_anything_else(
    tmp_path_factory: pytest.TempPathFactory, lines: list[str]
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.log"
    path.write_text("\n".join(lines), encoding="utf-8")
    logged: list[Logged] = []
    try:
        logged.extend(open_log(path))
    except LogError:
        assert not logged


# Loss, by cause


def test_frames_that_a_node_would_refuse_are_counted_by_cause(
    constant: Run, tmp_path: Path
) -> None:
    entries = entries_of(constant.log)
    places = [i for i, entry in enumerate(entries) if is_of(entry, "LATERAL_ERROR")]
    changed: dict[int, list[LogEntry]] = {}
    entry = entries[places[10]]
    changed[places[10]] = []  # lost
    broken = bytearray(entries[places[20]].frame.data)
    broken[5] ^= 1
    changed[places[20]] = [entries[places[20]]._replace(frame=Frame(0x110, bytes(broken)))]
    changed[places[30]] = [entries[places[30]]] * 2  # twice
    changed[places[40]] = []  # overtaken by the next
    changed[places[41]] = [
        entries[places[41]],
        entries[places[40]]._replace(time_ns=entries[places[41]].time_ns),
    ]
    changed[places[50]] = [entry._replace(frame=Frame(0x110, b"\0"))]
    changed[places[60]] = [entry._replace(frame=Frame(0x55, b"\0"))] * 3
    path = write_log(
        tmp_path / "changed.log",
        (one for i, entry in enumerate(entries) for one in changed.get(i, [entry])),
    )
    figures = analyse(path)
    message = figures["messages"]["LATERAL_ERROR"]
    assert message["refused"] == {"bad_crc": 1, "repeated": 1, "wrong_length": 1}
    assert message["late"] == 1
    assert message["missing"] == 5  # 10, 20, 40 (it came late), 50 and 60
    assert figures["foreign_ids"] == {"55": 3}
    others = [name for name in figures["messages"] if name != "LATERAL_ERROR"]
    assert [figures["messages"][name]["missing"] for name in others] == [0] * len(others)


def test_a_gap_is_told_with_its_place(constant: Run, tmp_path: Path) -> None:
    entries = entries_of(constant.log)
    start_ns = entries[0].time_ns
    kept = [
        entry
        for entry in entries
        if not (is_of(entry, "STEERING_COMMAND") and 5.0 <= 1e-9 * (entry.time_ns - start_ns) < 5.4)
    ]
    gaps = analyse(write_log(tmp_path / "gap.log", kept))["gaps"]
    assert [gap["name"] for gap in gaps] == ["STEERING_COMMAND"]
    assert gaps[0]["at_s"] == pytest.approx(5.0, abs=PERIOD_S + ON_THE_WIRE_S)
    assert gaps[0]["duration_s"] == pytest.approx(0.4 + PERIOD_S, abs=ON_THE_WIRE_S + PERIOD_S)


def test_a_change_of_the_latency_is_told(tmp_path: Path) -> None:
    path = tmp_path / "set.log"
    path.write_text("(1.000000) vcan0 123#00\n(3.500000) vcan0 320#2320032C016400\n")
    (config,) = analyse(path)["latency_configs"]
    assert config == {
        "at_s": 2.5, "direction": "BOTH", "model": "NORMAL",
        "mean_s": pytest.approx(0.08), "spread_s": pytest.approx(0.03), "loss": pytest.approx(0.01),
    }  # fmt: skip


# What is left on disk


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="ascii") as file:
        return list(csv.DictReader(file))


def test_the_table_holds_the_newest_of_every_signal(tmp_path: Path) -> None:
    command = SteeringCommand(0.12345, 7, Mode.ACTIVE)
    path = write_log(
        tmp_path / "run.log",
        [
            LogEntry(5_000_000, "c", encode(command, 0)),
            LogEntry(7_500_000, "c", encode(LateralError(-0.25, 0.002), 0)),
            LogEntry(9_000_000, "c", encode(command._replace(steer_rad=0.2), 1)),
        ],
    )
    written(tmp_path / "out", path)
    rows = rows_of(tmp_path / "out" / "run" / "signals.csv")
    assert [(row["time_s"], row["message"]) for row in rows] == [
        ("0.000000", "STEERING_COMMAND"),
        ("0.002500", "LATERAL_ERROR"),
        ("0.004000", "STEERING_COMMAND"),
    ]
    assert [row["steering_command.steer_rad"] for row in rows] == ["0.12345", "0.12345", "0.20000"]
    assert [row["steering_command.mode"] for row in rows] == ["1", "1", "1"]
    assert [row["lateral_error.lateral_error_m"] for row in rows] == ["", "-0.250000", "-0.250000"]
    assert all(row["plant_status.lost"] == "" for row in rows)


@NEEDS_PYARROW
def test_parquet_holds_the_same_as_csv(varying: Run, tmp_path: Path) -> None:
    import pyarrow.parquet

    figures = written(tmp_path / "out", varying.log, "--parquet")
    folder = tmp_path / "out" / "run"
    table = pyarrow.parquet.read_table(folder / "signals.parquet")
    rows = rows_of(folder / "signals.csv")
    assert table.num_rows == len(rows) == sum(m["accepted"] for m in figures["messages"].values())
    assert table.column_names == list(rows[0])
    for name in ("time_s", "lateral_error.lateral_error_m", "steering_status.applied_counter"):
        values = [math.nan if v is None else v for v in table[name].to_pylist()]
        wanted = [float(row[name] or "nan") for row in rows]
        np.testing.assert_allclose(values, wanted, atol=1e-6)


@NEEDS_MCAP
def test_mcap_holds_every_message_with_its_time_schema_and_names(
    varying: Run, tmp_path: Path
) -> None:
    from mcap.reader import make_reader

    figures = written(tmp_path / "out", varying.log, "--mcap")
    counts: dict[str, int] = {}
    with (tmp_path / "out" / "run" / "signals.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            assert channel.topic == f"/{schema.name}"
            content = json.loads(message.data)
            properties = json.loads(schema.data)["properties"]
            assert set(content) == set(properties)
            if schema.name == "STEERING_COMMAND":
                assert content["mode_name"] == Mode(content["mode"]).name
            counts[schema.name] = counts.get(schema.name, 0) + 1
            last_ns = message.log_time
    accepted = {name: m["accepted"] for name, m in figures["messages"].items() if m["accepted"]}
    assert counts == accepted
    assert last_ns <= entries_of(varying.log)[-1].time_ns


@pytest.mark.parametrize(
    ("library", "option"), [("pyarrow", "--parquet"), ("mcap.writer", "--mcap")]
)
def test_a_missing_library_is_one_clear_line_that_names_the_extra(
    constant: Run,
    tmp_path: Path,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
    library: str,
    option: str,
) -> None:
    monkeypatch.setitem(__import__("sys").modules, library, None)
    arguments = [str(constant.log), "--out", str(tmp_path)]
    assert main([*arguments, option]) == ExitStatus.SETTINGS
    assert f"steer-by-wire-emulator[{option[2:]}]" in capsys.readouterr().err
    if option == "--parquet":
        assert main(arguments) == ExitStatus.OK
        assert not (tmp_path / "run" / "signals.parquet").exists()


def test_the_report_needs_nothing_but_itself(varying: Run, tmp_path: Path) -> None:
    written(tmp_path / "out", varying.log)
    page = (tmp_path / "out" / "run" / "report.html").read_text()
    assert page.count('<img alt="') == 3
    sources = re.findall(r"""(?:src|href)=["'](.{0,22})""", page)
    assert sources == ["data:image/png;base64,"] * 3
    assert not re.search(r"url\(|@import|<script|<link|<iframe", page)
    assert "PlantStatus" not in page
    for heading in ("Signals", "Latency and jitter", "Messages", "Lost and refused"):
        assert f"<h2>{heading}</h2>" in page


def test_a_name_in_a_log_cannot_become_part_of_the_page(tmp_path: Path) -> None:
    path = tmp_path / "a<script>.log"
    path.write_text("(1.0) <img/src=x> 123#11\n(1.1) c 123#11\n<script>alert(1)</script>\n")
    figures = written(tmp_path / "out", path)
    assert figures["channels"] == ["<img/src=x>", "c"]
    page = (tmp_path / "out" / "a<script>" / "report.html").read_text()
    assert "<script" not in page
    assert "<img/" not in page


# Several logs


def test_parts_of_one_log_give_the_figures_of_the_whole(varying: Run, tmp_path: Path) -> None:
    entries = entries_of(varying.log)
    half = len(entries) // 2
    parts = [
        write_log(tmp_path / f"{name}.log", part)
        for name, part in (("first", entries[:half]), ("second", entries[half:]))
    ]
    joined = written(tmp_path / "out", "--join", *parts)
    assert joined["files"] == [str(part) for part in parts]
    same_but_for_times(analyse(varying.log), joined)


def test_several_logs_stand_beside_each_other(
    constant: Run, varying: Run, tmp_path: Path, capsys: Capture
) -> None:
    out = tmp_path / "out"
    assert main([str(constant.log), str(varying.log), "--out", str(out)]) == ExitStatus.OK
    printed = capsys.readouterr().out
    assert "lateral error, RMS [mm]" in printed
    assert sorted(path.name for path in out.iterdir()) == ["run_log-1", "run_log-2"]
    for path in out.iterdir():
        assert {file.name for file in path.iterdir()} >= {
            "report.html", "figures.json", "signals.csv"
        }  # fmt: skip


def test_of_several_channels_one_can_be_chosen(
    constant: Run, tmp_path: Path, capsys: Capture
) -> None:
    entries = entries_of(constant.log)
    doubled = [
        entry._replace(channel=channel) for entry in entries for channel in ("vcan0", "vcan1")
    ]
    path = write_log(tmp_path / "both.log", doubled)
    out = tmp_path / "out"
    assert main([str(path), "--out", str(out)]) == ExitStatus.OK
    assert "several channels (vcan0, vcan1): choose with --channel" in capsys.readouterr().out
    assert main([str(path), "--out", str(out), "--channel", "vcan1"]) == ExitStatus.OK
    figures = json.loads((out / "both" / "figures.json").read_text())
    assert (figures["frames"], figures["refused"]) == (len(entries), {})
    assert main([str(path), "--out", str(out), "--channel", "can7"]) == ExitStatus.SETTINGS
    assert "no frame of channel can7; in the log: vcan0, vcan1" in capsys.readouterr().err


# Long logs


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=400))
def test_a_thinned_history_keeps_its_peaks_and_its_order(values: list[float]) -> None:
    history = History(points_max=16)
    for index, value in enumerate(values):
        history.add(float(index), value)
    time_s, kept = history.points()
    assert len(kept) < 16
    assert kept.max() == max(values)
    assert kept.min() == min(values)
    assert list(time_s) == sorted(time_s)
    assert all(values[int(at)] == value for at, value in zip(time_s, kept, strict=True))
    report = history.report()
    assert report["rms"] == pytest.approx(float(np.sqrt(np.mean(np.square(values)))))
    assert abs(report["peak"]) == max(abs(value) for value in values)


def test_a_vehicle_that_stands_on_its_path_has_its_peak_at_its_first_sample(tmp_path: Path) -> None:
    frames = [encode(LateralError(0.0, 0.0), counter) for counter in range(20)]
    entries = [LogEntry(10_000_000 * index, "can0", frame) for index, frame in enumerate(frames)]
    log = write_log(tmp_path / "standing.log", entries)
    error = written(tmp_path / "out", log)["signals"]["lateral_error_m"]
    assert (error["rms"], error["peak"], error["peak_at_s"]) == (0.0, 0.0, 0.0)


def test_a_file_that_is_no_log_leaves_nothing_and_keeps_no_other_from_its_report(
    constant: Run, tmp_path: Path, capsys: Capture
) -> None:
    bad, gone, out = tmp_path / "bad.blf", tmp_path / "gone.log", tmp_path / "deep" / "out"
    bad.write_bytes(b"no log at all")
    assert main([str(bad), str(gone), "--out", str(out)]) == ExitStatus.SETTINGS
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    for line, path in zip(lines, (bad, gone), strict=True):
        assert line.startswith(f"analyze_log: error: {path}: ")
    assert not out.parent.exists()
    assert main([str(bad), str(constant.log), "--out", str(out)]) == ExitStatus.SETTINGS
    told = capsys.readouterr()
    assert str(bad) in told.err
    assert "report: " in told.out
    assert [path.name for path in out.iterdir()] == [constant.log.stem]
    assert (out / constant.log.stem / "report.html").exists()
    before = (out / constant.log.stem / "signals.csv").read_bytes()
    assert main([str(constant.log), "--channel", "none", "--out", str(out)]) == ExitStatus.SETTINGS
    assert (out / constant.log.stem / "signals.csv").read_bytes() == before
