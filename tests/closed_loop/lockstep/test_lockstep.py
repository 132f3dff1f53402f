"""A program in lockstep: the same run as our own node's, and one line for each way to fail."""

import _ctypes
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.lockstep.node import LockstepNode
from steer_by_wire.closed_loop.lockstep.peer import LockstepProgram
from steer_by_wire.closed_loop.lockstep.record import (
    DEADLINE,
    FRAMES,
    FRAMES_MAX,
    MARK,
    RECORD_BYTES,
    START,
    WAKE_ON_FRAMES,
    Record,
    RecordError,
    pack,
    unpack,
)
from steer_by_wire.closed_loop.processes.process_group import ProcessError
from steer_by_wire.closed_loop.rig.rig import Rig
from steer_by_wire.runtime.frame import EXTENDED, FD, Frame
from steer_by_wire.runtime.node import NEVER_NS, NS_PER_S
from steer_by_wire.tools.run.__main__ import main
from tests.support.wire.random_frames import sendable_frames

OURS = [sys.executable, "-m", "tests.closed_loop.lockstep.lockstep_controller"]
ECHO = f"""
import sys
while record := sys.stdin.buffer.read({RECORD_BYTES}):
    sys.stdout.buffer.write(EXPRESSION)
    sys.stdout.buffer.flush()
"""
times = st.integers(-(2**63), 2**63 - 1)
records = st.builds(
    Record,
    st.integers(0, 0xFFFF),
    times,
    st.lists(st.tuples(times, sendable_frames()), max_size=FRAMES_MAX),
)


def answering(expression: str) -> list[str]:
    """Return a program whose answer to ``record`` is the expression's value."""
    return [sys.executable, "-c", ECHO.replace("EXPRESSION", expression)]


@given(records)
def test_a_record_comes_back_from_its_bytes(record: Record) -> None:
    packed = pack(record)
    assert len(packed) == RECORD_BYTES
    assert unpack(packed) == record


@given(st.binary(min_size=RECORD_BYTES, max_size=RECORD_BYTES), st.integers(0, 40))
def test_any_bytes_are_a_record_or_an_error(content: bytes, count: int) -> None:
    record = MARK + content[4:6] + count.to_bytes(2, "little") + content[8:]
    try:
        unpacked = unpack(record)
    except RecordError:
        return
    assert len(unpacked.frames) == count <= FRAMES_MAX


@pytest.mark.parametrize("preset", ["practical_pd_ddob", "practical_predictor"])
def test_our_node_in_a_program_of_its_own_makes_the_same_run(preset: str, tmp_path: Path) -> None:
    network = {"latency.downlink.mean_s": 0.05, "duration_s": 1.5}
    rig = Rig(tmp_path, "paper_nominal", network, seed=5)
    inside = rig.run(preset)
    outside = rig.run([*OURS, preset], lockstep=True)
    assert outside.files.candump_log.read_bytes() == inside.files.candump_log.read_bytes()
    assert outside.report == inside.report
    assert outside.ending == ""


def test_a_program_that_polls_finds_its_frames_at_its_deadline() -> None:
    later = "record[:4] + b'\\0\\0\\0\\0' + (int.from_bytes(record[8:16], 'little') + 100)"
    with LockstepProgram(answering(f"{later}.to_bytes(8, 'little') + record[16:]")) as program:
        node = LockstepNode(program, 0)
        node.on_frame(Frame(1, b"before the start"[:8]), 0)
        node.on_tick(0)
        assert node.deadline_ns == 100
        for time_ns in range(1, FRAMES_MAX):
            assert node.on_frame(Frame(time_ns, b""), time_ns) == ()
        assert node.report()["wakes"] == 1
        node.on_frame(Frame(0x7FF, b"full"), 50)  # no room for another one
        assert node.report()["wakes"] == 2
        node.on_tick(150)
    assert node.report() == {
        "program": Path(sys.executable).name,
        "wakes": 3,
        "frames_received": FRAMES_MAX,
        "frames_sent": 0,
        "failure": "",
    }


def test_every_frame_wakes_one_that_asks_for_it() -> None:
    sent = Record(WAKE_ON_FRAMES, 2**63 - 1, [(0, Frame(0x1ABCDE, b"x" * 64, EXTENDED | FD))])
    with LockstepProgram(answering(repr(pack(sent)))) as program:
        node = LockstepNode(program, 0)
        assert node.on_tick(0) == [sent.frames[0][1]]
        assert node.on_frame(Frame(1, b""), 1) == [sent.frames[0][1]]


FAILURES = {
    "one that ends": ([sys.executable, "-c", "raise SystemExit(3)"], "ended with status 3$"),
    "its last line": (
        [sys.executable, "-c", "raise OSError('no such bus')"],
        "ended with status 1; its last line: OSError: no such bus$",
    ),
    "its last line would act on the terminal": (
        [sys.executable, "-c", r"raise SystemExit('\x1b[2Jna\xefve \x9d0;title\x07')"],
        r"its last line: \\x1b\[2Jna\xefve \\x9d0;title\\x07$",
    ),
    "a crash": ([sys.executable, "-c", "import os; os.kill(os.getpid(), 11)"], "ended by SIGSEGV$"),
    "a banner": (
        [sys.executable, "-c", "print('Welcome', flush=True); input()"],
        r"its standard output: a record begins with b'LSP1', this with b'Welcome(\\n)?'$",
    ),
    "half a record": (
        [sys.executable, "-c", "print(end='LSP1')"],
        "ended with status 0 after 4 of 1296 bytes of an answer$",
    ),
    "too many frames": (
        answering("record[:6] + b'\\x11\\0' + record[8:]"),
        "17 frames in one record .allowed: 0 to 16.$",
    ),
    "no such identifier": (
        answering(repr(pack(Record(0, 9, [(0, Frame(0x800, b""))])))),
        "frame 0 of 0x800: not a frame that can be sent",
    ),
}


def test_programs_run_where_libraries_cannot_be_unloaded() -> None:
    windows = "import _ctypes; del _ctypes.dlclose; import steer_by_wire.tools.run.__main__"
    subprocess.run([sys.executable, "-c", windows], check=True)


def test_a_library_that_cannot_be_used_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, other = tmp_path / "text.so", str(_ctypes.__file__)
    text.write_text("no library")
    for words, said in (
        ("ecu.so --fast", "ecu.so: a shared library takes no words: leave out --fast"),
        ("ecu.so", "ecu.so: No such file or directory"),
        (str(text), f"{text}: file too short"),
        (other, f"{other}: has no function lockstep_exchange: see lockstep.h"),
    ):
        assert main(["--controller-command", words]) == (2 if "--fast" in words else 3)
        assert capsys.readouterr().err == f"steer-by-wire run: error: {said}\n"


@pytest.mark.parametrize("name", FAILURES)
def test_a_program_that_fails_is_one_line_and_the_verdict(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words, pattern = FAILURES[name]
    assert main(["--duration", "1", "--controller-command", shlex.join(words)]) == 5
    out = capsys.readouterr().out
    assert "without a command" not in out  # a program that waits is another thing
    last = out.splitlines()[-1]
    assert re.match(r"verdict +failed: controller: at 0\.000 s: ", last)
    assert re.search(pattern, last)


def test_one_that_sends_nothing_ends_with_a_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for module in ("closed_loop.pair.virtual_pair", "tools.run.result"):
        monkeypatch.setattr(f"steer_by_wire.{module}.START_S_MAX", 2)
    program = Path(__file__).with_name("silent_program.py")
    assert main(["--controller-command", f"{sys.executable} {program}"]) == 5
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.endswith("failed: controller: it sent no valid command in 2 s")


def test_one_that_hangs_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("steer_by_wire.closed_loop.lockstep.peer.ANSWER_TIMEOUT_S", 0.05)
    monkeypatch.setattr("steer_by_wire.closed_loop.lockstep.peer.END_TIMEOUT_S", 0.05)
    with (
        pytest.raises(ProcessError, match=r"sleep: 0 of 1296 bytes of an answer within 0\.05 s"),
        LockstepProgram(["sleep", "1000"]) as program,
    ):
        program.exchange(Record(START, 0))
    with pytest.raises(ProcessLookupError):
        os.killpg(program.pid, 0)


def test_one_that_does_not_read_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("steer_by_wire.closed_loop.lockstep.peer.ANSWER_TIMEOUT_S", 0.5)
    answer = repr(pack(Record(WAKE_ON_FRAMES, NEVER_NS)))
    deaf = f"import os\nwhile True: os.write(1, {answer})"
    said = ""
    with LockstepProgram([sys.executable, "-c", deaf]) as program:
        for _ in range(1000):
            try:
                program.exchange(Record(FRAMES, 0))
            except ProcessError as error:
                said = str(error)
                break
    assert re.search(r"has not read its standard input within 0\.5 s$", said)


def test_one_that_fails_on_the_way_is_one_line_with_the_time(tmp_path: Path) -> None:
    too_long = pack(Record(WAKE_ON_FRAMES, NEVER_NS)) + b"bye"
    rig = Rig(tmp_path, overrides={"duration_s": 1.0})
    ending = rig.run(answering(repr(too_long)), lockstep=True).ending
    assert re.fullmatch(r"controller at 0\.0\d\d s: .* this with b'bye.*", ending)


def test_a_slow_program_makes_the_same_run(tmp_path: Path) -> None:
    rig = Rig(tmp_path, "paper_nominal", {"duration_s": 0.5})
    slow = [*OURS, "practical_pd", "0.003"]
    runs = [rig.run(words, lockstep=True) for words in (slow[:-1], slow)]
    quick, slowed = (run.files.candump_log.read_bytes() for run in runs)
    assert quick == slowed
    assert runs[0].report["accepted"] > 40


def test_one_that_wakes_without_end_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("steer_by_wire.closed_loop.lockstep.node.WAKES_MAX", 100)
    program: Any = SimpleNamespace(name="hasty")
    for step_ns, wakes in ((10_000_000, 201), (9_999_999, 101)):
        program.exchange = lambda asked, step_ns=step_ns: Record(0, asked.time_ns + step_ns)
        node = LockstepNode(program, 0)
        while not node.finished and node.deadline_ns <= 2 * NS_PER_S:
            node.on_tick(node.deadline_ns)
        assert node.report()["wakes"] == wakes
    assert node.failure == "at 1.000 s: hasty: woken more than 100 times a second"


def test_a_deadline_must_move_on_but_may_wait_beside_frames() -> None:
    with LockstepProgram(answering(repr(pack(Record(WAKE_ON_FRAMES, 5))))) as program:
        node = LockstepNode(program, 5)
        node.on_tick(5)
        assert node.failure == ""
        node.on_frame(Frame(1, b""), 5)
        assert node.failure == ""
        node.on_tick(5)
        assert node.failure.endswith("its next deadline, 5 ns, is not after now, 5 ns")
        assert node.finished
        assert node.on_frame(Frame(1, b""), 6) == ()


def test_the_header_has_the_layout_of_the_record(tmp_path: Path) -> None:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler: the header was not compiled")
    header = Path(sys.modules[LockstepNode.__module__].__file__ or "").with_name("lockstep.h")
    facts = {
        "sizeof(struct lockstep_record)": RECORD_BYTES,
        "offsetof(struct lockstep_record, frames[1].data)": 16 + 80 + 16,
        "LOCKSTEP_MARK": int.from_bytes(MARK, "little"),
        "LOCKSTEP_START * 100 + LOCKSTEP_DEADLINE * 10 + LOCKSTEP_FRAMES": 100 * START
        + 10 * DEADLINE
        + FRAMES,
        "LOCKSTEP_EXTENDED + 100 * LOCKSTEP_FD": EXTENDED + 100 * FD,
    }
    checks = "".join(f'_Static_assert({fact} == {value}, "");' for fact, value in facts.items())
    source = tmp_path / "facts.c"
    source.write_text(f'#include <stddef.h>\n#include "{header}"\n{checks}\n')
    subprocess.run(["cc", "-std=c11", "-Wall", "-Werror", "-fsyntax-only", str(source)], check=True)
