"""The screen shows what there is to see, and never keeps the loop waiting."""

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

import pytest

from steer_by_wire.runtime.node import NS_PER_S, View
from steer_by_wire.runtime.program.screen import (
    COUNT_NS,
    QUEUED_MAX,
    STATE_LINES,
    STATE_NS,
    Changes,
    Observer,
    Screen,
)

START_NS = 5 * NS_PER_S


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@contextmanager
def pipe_that_nobody_reads() -> Iterator[tuple[int, TextIO]]:
    """A pipe that is full to the brim: its reading end, and what writes to the other."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    for size in (4096, 1):
        with suppress(BlockingIOError):
            while True:
                os.write(writing, b"x" * size)
    os.set_blocking(writing, True)
    with os.fdopen(writing, "w") as stream:
        yield reading, stream
        os.close(reading)


def observed(screen: Screen, seconds: float) -> None:
    """Show a node that counts its looks, as an executor that wakes up each millisecond would."""
    looks = 0

    def look(_now_ns: int) -> View:
        nonlocal looks
        looks += 1
        return View({"mode": "on" if looks < 30 else "off"}, {}, f"look {looks}")

    observer = Observer(look, screen, START_NS)
    screen.start()
    for ms in range(round(1000 * seconds)):
        observer(START_NS + ms * 1_000_000)
    screen.close()


def test_without_a_terminal_there_are_lines_and_no_status_line() -> None:
    stream = io.StringIO()
    observed(Screen("some-program", stream), 3.0)
    assert stream.getvalue() == "some-program: 0.00 s: on\nsome-program: 1.45 s: off\n"


def test_on_a_terminal_the_status_line_is_rewritten_once_a_second_below_the_lines(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "12")
    monkeypatch.setenv("TERM", "xterm")
    stream = Terminal()
    observed(Screen("some-program", stream), 2.5)
    clear = "\r\x1b[K"
    assert stream.getvalue().split(clear)[1:] == [
        "some-program: 0.00 s: on\n",
        "0 s  look 1",
        "1 s  look 2",
        "some-program: 1.45 s: off\n1 s  look 2",
        "2 s  look 4",
        "",
    ]


def test_a_pipe_that_nobody_reads_blocks_neither_the_lines_nor_the_end() -> None:
    with pipe_that_nobody_reads() as (reading, stream):
        screen = Screen("some-program", stream)
        screen.start()
        for number in range(QUEUED_MAX + 52):
            screen.line(str(number))
        # The thread holds at most one of them.
        assert 51 <= screen.dropped <= 52
        screen.close()
        while os.read(reading, 65_536)[-1:] == b"x":
            pass


def test_a_reader_that_has_gone_ends_nothing() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as stream:
        screen = Screen("some-program", stream)
        screen.start()
        screen.line("unread")
        screen.close()
    assert screen.dropped == 1


LOOK_NS = NS_PER_S // 20


def state(text: str) -> View:
    return View({"mode": text}, {}, "")


def test_a_state_is_one_line_each_time_it_changes() -> None:
    changes = Changes()
    seen = [list(changes.lines(state(text), 10 * STATE_NS * n)) for n, text in enumerate("aabba")]
    assert seen == [["a"], [], ["b"], [], ["a"]]


def test_a_state_that_flutters_is_limited_and_its_last_value_is_not_lost() -> None:
    changes = Changes()
    printed: list[str] = []
    for n in range(200):  # ten seconds
        printed += changes.lines(state("ab"[n % 2]), n * LOOK_NS)
    assert STATE_LINES <= len(printed) <= STATE_LINES + 1 + 10 * NS_PER_S // STATE_NS
    printed += changes.lines(state("c"), 20 * NS_PER_S)
    assert printed[-1] == "c"


def test_a_flood_of_bad_frames_is_counted_in_few_lines() -> None:
    changes = Changes()
    printed: list[str] = []
    for n in range(1, 201):
        counts = {"frames rejected, bad_crc": 1000 * n}
        printed += changes.lines(View({}, counts, ""), n * LOOK_NS)
    assert len(printed) == 1 + 199 * LOOK_NS // COUNT_NS
    assert printed[0] == "frames rejected, bad_crc: 1000"
    assert printed[1] == "frames rejected, bad_crc: 100000 more, 101000 so far"
