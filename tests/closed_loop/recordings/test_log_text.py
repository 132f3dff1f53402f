"""Whatever a text log says is read, or counted as not read, in each dialect of each format."""

import os
import re
import threading
from base64 import b64encode
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.recordings import log_file
from steer_by_wire.closed_loop.recordings.log_analysis import analyse_files
from steer_by_wire.closed_loop.recordings.log_file import LogFile, open_log
from steer_by_wire.closed_loop.recordings.logged import LogError, Logged
from steer_by_wire.dbc.contract.enumerations import SecondSender
from steer_by_wire.dbc.messages import PlantStatus, Sender, SteeringStatus, SteeringStatusCode
from steer_by_wire.runtime.frame import ERROR, Frame
from tests.support.frames.made_messages import message_with
from tests.support.runs.logged_run import analyse

ASC = "date Sat Nov 28 09:15:02 am 2026\nbase hex  timestamps {kind}\n{events}"
EVENTS = "internal events logged\n"


def asc(n: int, name: str = "", direction: str = "Rx") -> str:
    return f"{n * 0.01:.6f} 1  {name or f'{0x100 + n:X}'}  {direction}   d 8 {payload(n)}"


def payload(n: int, separator: str = " ") -> str:
    return separator.join([f"{n:02X}"] * 8)


LINES: dict[str, tuple[str, str, Callable[[int], str]]] = {
    "busmaster.asc": (".asc", ASC.format(kind="absolute", events=""), asc),
    "vector.asc": (".asc", ASC.format(kind="absolute", events=EVENTS), asc),
    "fd.asc": (
        ".asc",
        ASC.format(kind="absolute", events=EVENTS),
        lambda n: f"{n * 0.01} CANFD 1 Rx {0x100 + n:X} NAME 1 0 8 8 {payload(n)} 120 130 303000 A",
    ),
    "1.0.trc": (
        ".trc",
        "; by hand\n",
        lambda n: f"{n})  {n * 10.0}  {0x100 + n:04X}  8  {payload(n)}",
    ),
    "1.1.trc": (
        ".trc",
        ";$FILEVERSION=1.1\n",
        lambda n: f"{n})  {n * 10.0} Rx {0x100 + n:04X}  8  {payload(n)}",
    ),
    "1.2.trc": (
        ".trc",
        ";$FILEVERSION=1.2\n",
        lambda n: f"{n})  {n * 10.0} 1 Rx {0x100 + n:04X}  8  {payload(n)}",
    ),
    "1.3.trc": (
        ".trc",
        ";$FILEVERSION=1.3\n",
        lambda n: f"{n})  {n * 10.0} 1 Rx {0x100 + n:04X} - 8  {payload(n)}",
    ),
    "2.1.trc": (
        ".trc",
        ";$FILEVERSION=2.1\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n",
        lambda n: f"{n}  {n * 10.0} DT 1 {0x100 + n:04X} Rx - 8  {payload(n)}",
    ),
    "savvycan.csv": (
        ".csv",
        "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n",
        lambda n: f"{n * 10000},{0x100 + n:08X},false,Rx,0,8,{payload(n, ',')},",
    ),
    "savvycan.csv, saved by a spreadsheet": (
        ".csv",
        "Time Stamp;ID;Extended;Dir;Bus;LEN;D1;D2;D3;D4;D5;D6;D7;D8\n",
        lambda n: f"{n * 10000};{0x100 + n:08X};false;Rx;0;8;{payload(n, ';')}",
    ),
    "python-can.csv": (
        ".csv",
        "timestamp,arbitration_id,extended,remote,error,dlc,data\n",
        lambda n: f"{n * 0.01},0x{0x100 + n:x},0,0,0,8,{b64encode(bytes([n] * 8)).decode()}",
    ),
    "candump -L": (".log", "", lambda n: f"({n * 0.01:.6f}) can0 {0x100 + n:03X}#{payload(n, '')}"),
    "candump -ta": (
        ".txt",
        "",
        lambda n: f" ({n * 0.01:.6f})  can0  {0x100 + n:03X}   [8]  {payload(n)}",
    ),
    "candump -S": (
        ".txt",
        "",
        lambda n: f" ({n * 0.01:.6f})  can0  {0x100 + n:03X}   [8]  {payload(n, '`')}",
    ),
    "candump -i": (
        ".txt",
        "",
        lambda n: f" ({n * 0.01:.6f})  can0  {0x100 + n:03X}   [8] " + 8 * f" {n:08b}",
    ),
}
COUNT = 20
FRAMES = [(0x100 + n, bytes([n] * 8)) for n in range(1, COUNT)]


def read(path: Path, text: str, encoding: str = "utf-8") -> tuple[list[Logged], LogFile]:
    path.write_bytes(text.encode(encoding))
    log = open_log(path)
    return list(log), log


def frames(logged: list[Logged]) -> list[tuple[int, bytes]]:
    return [(one.frame.can_id, one.frame.data) for one in logged]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
@pytest.mark.parametrize("kind", LINES)
def test_each_dialect_is_read_as_any_editor_saves_it(
    tmp_path: Path, kind: str, line_end: str, encoding: str
) -> None:
    suffix, head, line = LINES[kind]
    text = head + "".join(f"{line(n)}\n" for n in range(1, COUNT)) + "\n"
    logged, state = read(tmp_path / f"log{suffix}", text.replace("\n", line_end), encoding)
    assert frames(logged) == FRAMES
    assert (state.unreadable, state.cut_off) == (0, "")
    times = [one.time_ns for one in logged if one.time_ns is not None]
    assert times[-1] - times[0] == pytest.approx(180_000_000, abs=1000)


@pytest.mark.parametrize("kind", LINES)
@given(data=st.data())
def test_a_line_that_is_cut_changed_doubled_or_swapped_is_read_or_counted(
    kind: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    suffix, head, line = LINES[kind]
    lines, is_changed = [line(n) for n in range(1, COUNT)], kind == "candump -L"  # no lengths
    for place in data.draw(st.sets(st.integers(1, len(lines) - 1), max_size=4)):
        damage = data.draw(st.sampled_from(["short", "changed", "doubled", "swapped"]))
        if damage == "short":
            kept = data.draw(st.integers(1, max(len(lines[place]) - 1, 1)))
            lines[place] = lines[place][:kept].strip() or "?"
        elif damage == "changed":
            at = data.draw(st.integers(0, len(lines[place]) - 1))
            put = data.draw(st.text(" \t09,Ax", max_size=3))
            behind = lines[place][at + data.draw(st.integers(0, 3)) :]
            lines[place], is_changed = (lines[place][:at] + put + behind).strip() or "?", True
        elif damage == "doubled":
            lines.insert(place, lines[place])
        else:
            lines[place - 1 : place + 1] = reversed(lines[place - 1 : place + 1])
    path = tmp_path_factory.mktemp("log") / f"log{suffix}"
    logged, state = read(path, head + "\n".join([*lines, ""]))
    assert len(logged) + state.unreadable == len(lines)
    is_placed = re.match(rf"{re.escape(str(path))}:\d+: no frame", state.first_unreadable)
    assert bool(is_placed) == bool(state.unreadable)
    assert is_changed or {*frames(logged)} <= {*FRAMES}


def test_an_asc_with_relative_or_negative_times_requests_and_other_events(tmp_path: Path) -> None:
    path = tmp_path / "log.asc"
    relative = ASC.format(kind="relative", events=EVENTS) + (
        "Begin Triggerblock Sat\n 0.0 Start of measurement\n0.5 1 100 Rx d 1 AA\n"
        "0.25 CAN 1 Status:chip status error active\n0.25 1 ErrorFrame\n0.5 1 101x Tx r\n"
        f"0.0 1 J1939TP FEE3p 6 0 0 - Rx d 9 {payload(1)} 01\n"
        "End TriggerBlock\n\n// checked by hand"
    )
    logged, state = read(path, relative)
    assert [one.time_ns for one in logged] == [500_000_000, 1_000_000_000, 1_500_000_000]
    assert logged[1].frame == Frame(0, b"", ERROR)
    assert (state.unreadable, state.cut_off) == (0, "")
    early = f"-0.4 1 100 Rx d 0\n{asc(2)}\n{asc(3, direction='TxRq')}\n"
    logged, state = read(path, ASC.format(kind="absolute", events="") + early)
    assert [one.time_ns for one in logged] == [-400_000_000, 20_000_000]
    assert state.unreadable == 0


def test_error_frames_of_a_trc_and_the_words_of_candump(tmp_path: Path) -> None:
    text = (
        ";$FILEVERSION=1.1\n1) 1.0 Error 0008 4 00 19 08 08\n2) 2.0 Warng FFFFFFFF 4 00 00 00 08\n"
    )
    logged, state = read(tmp_path / "log.trc", text)
    assert [one.frame.flags for one in logged] == [ERROR]
    words = "  can0  20000004   [8]  00 04 00 00 00 00 60 00   ERRORFRAME\n\tcontroller-problem{}\n"
    words += "\terror-counter-tx-rx{{96}{0}}\n  can0  100   [1]  01\n"
    words += "(1.0) can0 20000040#0000000000000000\n"
    logged, words_state = read(tmp_path / "log.txt", words)
    assert [one.frame.flags for one in logged] == [ERROR, 0, ERROR]
    assert state.unreadable == words_state.unreadable == 0


def test_of_commands_that_were_not_read_none_is_said_to_be_missing(tmp_path: Path) -> None:
    path = tmp_path / "named.asc"
    named = "".join(f"{asc(n, 'STEERING_COMMAND')}\n" for n in range(1, 9))
    sent = "".join(f"{n * 0.01} 1 320 Rx d 7 23 20 03 2C 01 64 00\n" for n in range(1, 9))
    path.write_text(ASC.format(kind="absolute", events="") + named + sent)
    figures = analyse(path)
    assert figures["not_judged"] == "no command was read; 8 lines or objects were not read"
    assert "export it as number" in figures["first_unreadable"]


@given(step_ns=st.integers(0, 10**9))
def test_times_too_coarse_for_the_frames_make_no_latencies(
    step_ns: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path, frames = tmp_path_factory.mktemp("log") / "coarse.log", 300
    times = [10**7 * n // max(step_ns, 1) * step_ns for n in range(frames)]
    sent = "can0 320#2320032C016400\n"
    path.write_text("".join(f"({t // 10**9}.{t % 10**9:09}) {sent}" for t in times))
    figures = analyse(path)
    is_coarse = frames - len({*times}) >= 0.9 * frames
    assert (figures["times_too_coarse"], figures["has_times"]) == (is_coarse, not is_coarse)
    assert is_coarse <= (figures["messages"]["PLANT_STATUS"]["cycle"]["samples"] == 0)


@given(step_s=st.integers(1, 10**7), place=st.integers(2, 98))
def test_a_clock_set_back_costs_no_time_and_an_odd_time_sets_none(
    step_s: int, place: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("log") / "back.log"
    times = [1_795_000_000.0 + 0.01 * n for n in range(100)]

    def figures(changed: range) -> dict[str, object]:
        path.write_text(
            "".join(
                f"({time - step_s * (n in changed):.6f}) can0 320#2320032C016400\n"
                for n, time in enumerate(times)
            )
        )
        return analyse(path)

    back = figures(range(place, 100))
    assert (back["clock_set"], back["times_backwards"]) == (1, 0)
    assert back["duration_s"] == pytest.approx(0.99, abs=0.02)
    odd = figures(range(place, place + 1))
    assert (odd["clock_set"], odd["times_backwards"]) == (0, 1)
    assert odd["duration_s"] == pytest.approx(0.99)


def test_a_log_is_read_from_a_pipe(tmp_path: Path) -> None:
    path = tmp_path / "pipe.log"
    os.mkfifo(path)
    writer = threading.Thread(target=path.write_text, args=("(1.0) can0 100#00\n" * 20,))
    writer.start()
    log = open_log(path)
    assert len(list(log)) == 20
    writer.join()


def test_lines_without_a_frame_have_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_file, "LINES_MAX", 100)
    with pytest.raises(LogError, match="no frame in its first 100 lines"):
        read(tmp_path / "log.log", "\n" * 200)
    frame = "(1.0) can0 100#00\n"
    assert len(read(tmp_path / "log.log", "\n" * 50 + frame + "\n" * 200 + frame)[0]) == 2


def test_a_csv_of_another_program_names_the_columns(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"arbitration_id.*SavvyCAN"):
        read(tmp_path / "log.csv", "when,what\n1,2\n")


def test_a_log_of_the_plant_alone_lacks_no_command_and_tells_its_alarm(tmp_path: Path) -> None:
    path = tmp_path / "plant.log"
    status = Sender(SteeringStatus)
    alarm = Sender(PlantStatus).frame(message_with(PlantStatus, second_sender=SecondSender.PEER))
    for code in (SteeringStatusCode.APPLYING, SteeringStatusCode.NO_COMMAND):
        frames = [status.frame(message_with(SteeringStatus, status=code)) for _ in range(9)]
        frames.append(alarm)
        path.write_text("".join(f"(0.1) can0 {it.can_id:X}#{it.data.hex()}\n" for it in frames))
        figures = analyse_files([path]).figures
        is_applied = code is SteeringStatusCode.APPLYING
        assert ("the plant applied some" in figures["not_judged"]) == is_applied
        assert figures["second_sender_in"] == ["PLANT_STATUS"]
