"""Damage, losses and refusals in a log are counted by cause and cost nothing else."""

import gzip
import json
import re
from base64 import b64encode
from pathlib import Path
from random import Random

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.recordings.log_file import open_log
from steer_by_wire.closed_loop.recordings.logged import LogError, Logged
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.tools.analyze.__main__ import main
from tests.support.frames.recorded_frames import entries_in
from tests.support.runs.logged_run import Run, analyse, convert, is_of, write_log, written
from tests.support.runs.logged_run import beginning as beginning
from tests.support.runs.logged_run import constant as constant
from tests.support.runs.logged_run import varying as varying
from tests.support.suite.unrendered import unrendered as unrendered

pytestmark = pytest.mark.usefixtures("unrendered")

Capture = pytest.CaptureFixture[str]


SHORT = [Logged(n * 10_000_000, "can0", Frame(0x100 + n, bytes([n] * 8))) for n in range(40)]
COUNTED_ENDS = (".blf", ".log.gz")
"""Formats that state their length."""


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return a log of SHORT in each format."""
    folder = tmp_path_factory.mktemp("short")
    suffixes = (".log", ".csv", ".trc", ".asc", ".blf")
    logs = {suffix: convert(SHORT, folder / f"whole{suffix}") for suffix in suffixes}
    packed = folder / "whole.log.gz"
    packed.write_bytes(gzip.compress(logs[".log"].read_bytes()))
    return {**logs, ".log.gz": packed}


@pytest.mark.parametrize("suffix", [".log", ".csv", ".trc", ".asc", *COUNTED_ENDS])
@given(share=st.floats(0.0, 1.0, exclude_max=True))
def test_a_log_that_is_cut_anywhere_says_so_and_has_no_frame_that_was_not_there(
    short: dict[str, Path], suffix: str, share: float
) -> None:
    content = short[suffix].read_bytes()
    left = content[: int(share * len(content))]
    path = short[suffix].with_name(f"cut{suffix}")
    path.write_bytes(left)
    wanted = [entry.frame for entry in SHORT]
    frames: list[Frame] = []
    try:
        log = open_log(path)
        frames.extend(logged.frame for logged in log)
    except LogError:
        assert not frames
        return
    assert frames == wanted[: len(frames)]
    # Cut between the records of two lines, a text has nothing to notice.
    began = left.rpartition(b"\n")[2].strip()
    is_inside_a_line = began and content[len(left) :].lstrip(b"\r")[:1] != b"\n"
    if suffix in COUNTED_ENDS or is_inside_a_line:
        assert log.cut_off or frames == wanted


@pytest.mark.parametrize("suffix", [".log", ".csv", ".trc", ".asc"])
def test_a_line_that_is_cut_anywhere_is_no_frame(short: dict[str, Path], suffix: str) -> None:
    """Also where what is left reads as one: half of a payload, or all of a line but its end."""
    lines = short[suffix].read_bytes().splitlines(keepends=True)
    last = max(at for at, line in enumerate(lines) if is_of_byte(39, line))
    path = short[suffix].with_name(f"torn{suffix}")
    for length in range(len(lines[last].rstrip(b"\r\n")) + 1):
        left = lines[last][:length]
        path.write_bytes(b"".join([*lines[:last], left]))
        log = open_log(path)
        assert [logged.frame for logged in log] == [entry.frame for entry in SHORT[:39]]
        assert log.unreadable == bool(left.strip()) == bool(log.cut_off)


def is_of_byte(value: int, line: bytes) -> bool:
    """Whether a line of some format holds eight times a byte."""
    data = bytes([value] * 8)
    words = data.hex(), data.hex(" "), b64encode(data).decode()
    return any(word in line.decode() for word in words)


@pytest.mark.parametrize(
    ("name", "content", "line"),
    [
        ("empty.log", b"", "{path}: there is no frame in it"),
        ("words.log", b"\nonce upon a time\n", "{path}:2: no frame: 'once upon a time'"),
        ("table.csv", b"time_s,message\n1.0,X\n", "{path}: the columns of a .csv are "),
        ("head.trc", b";$FILEVERSION=2.1\n", "{path}: there is no frame in it"),
        ("new.trc", b";$FILEVERSION=3.0\n", "{path}: a .trc of version 3.0 is not read"),
        ("noise.blf", b"LOGG" + bytes(10), "{path}: no .blf file: "),
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
    assert error.startswith(f"steer-by-wire analyze: error: {line.format(path=path)}")


# Loss, by cause


@pytest.mark.parametrize("silent", [129, 150, 255, 256, 300])  # a turn has 256
def test_frames_that_a_node_would_refuse_are_counted_by_cause(
    constant: Run, tmp_path: Path, silent: int
) -> None:
    entries = entries_in(constant.log)
    places = [i for i, entry in enumerate(entries) if is_of(entry, "LATERAL_ERROR")]
    changed: dict[int, list[Logged]] = {at: [] for at in places[100 : 100 + silent]}
    entry = entries[places[10]]
    changed[places[10]] = []  # lost
    broken = bytearray(entries[places[20]].frame.data)
    broken[5] ^= 1
    changed[places[20]] = [entries[places[20]]._replace(frame=Frame(0x110, bytes(broken)))]
    changed[places[30]] = [entries[places[30]]] * 2  # twice
    changed[places[40]] = []  # overtaken by the next
    before, after = entries[places[40]], entries[places[41]]
    changed[places[41]] = [after, before._replace(time_ns=after.time_ns)]
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


def test_a_log_out_of_order_is_not_judged(
    constant: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    entries = entries_in(constant.log)
    Random(1).shuffle(entries)
    path = write_log(tmp_path / "shuffled.log", entries)
    out = ["--out", str(tmp_path / "out")]
    assert main([str(path), *out, "--fail-if", "verdict == unstable"]) == ExitStatus.CONDITION
    printed = capsys.readouterr()
    assert printed.out.splitlines()[-1].startswith("verdict: none: time runs backwards at ")
    assert "verdict has no value in this run" in printed.err
    assert "holds" not in printed.out
    (figures,) = tmp_path.rglob("figures.json")
    assert json.loads(figures.read_text(encoding="utf-8"))["held_path"]["verdict"] is None


def test_a_log_of_foreign_frames_only_is_not_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "foreign.log"
    path.write_text("".join(f"({n}.0) vcan0 7FF#01\n({n}.5) vcan0 18FEF100#02\n" for n in range(9)))
    assert main([str(path), "--out", str(tmp_path / "out")]) == ExitStatus.OK
    printed = capsys.readouterr().out
    assert re.search(r"foreign +18\n", printed)
    assert printed.splitlines()[-1] == (
        "verdict: none: none of 18 frames is a message of plant or controller "
        "(18 foreign, 0 refused)"
    )


@pytest.mark.parametrize("position", [1, 1500])
def test_a_clock_that_is_set_during_the_log_costs_no_time_and_is_reported(
    varying: Run, tmp_path: Path, position: int, capsys: Capture
) -> None:
    entries = [entry._replace(time_ns=entry.time_ns + 10**9) for entry in entries_in(varying.log)]
    set_ns = 1_790_000_000 * 10**9
    later = [entry._replace(time_ns=entry.time_ns + set_ns) for entry in entries[position:]]
    path = write_log(tmp_path / "set.log", [*entries[:position], *later])
    figures = written(tmp_path / "out", path)
    assert "clock changes: 1; the jumps in time are left out" in capsys.readouterr().out
    whole = analyse(varying.log)
    # But for the one distance between two frames.
    assert figures["duration_s"] == pytest.approx(whole["duration_s"], abs=0.02)
    assert figures["held_path"]["verdict"] == whole["held_path"]["verdict"]


WRITTEN = {".asc": "1  110  ", ".csv": ",0x110,", ".trc": " 0110 "}


@pytest.mark.parametrize("suffix", WRITTEN)
@given(identifier=st.integers(-(10**6), 10**24) | st.sampled_from([-1, 0x7FF, 0x800, 10**23]))
def test_an_identifier_that_no_frame_has_is_damage_and_no_foreign_frame(
    suffix: str, identifier: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.mktemp("log") / f"one{suffix}"
    with can.Logger(file) as log:
        for time_s in (1.0, 2.0):
            log(can.Message(timestamp=time_s, arbitration_id=0x110, is_extended_id=False))
    text, found = file.read_text(encoding="utf-8"), WRITTEN[suffix]
    place = text.rindex(found)
    changed = found.replace("0x110", "110").replace("0110", "110").replace("110", f"{identifier:x}")
    file.write_text(text[:place] + changed + text[place + len(found) :], encoding="utf-8")
    log_file = open_log(file)
    read = [logged.frame.can_id for logged in log_file]
    # Of more than four digits .trc has an extended identifier.
    is_extended = suffix == ".trc" and identifier > 0xFFFF
    is_one = 0 <= identifier < 1 << (29 if is_extended else 11)
    assert read == ([0x110, identifier] if is_one else [0x110])
    assert log_file.unreadable == (not is_one)
