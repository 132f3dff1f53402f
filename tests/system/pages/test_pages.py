"""Python, commands and files on the pages run, and print what the pages show."""

import argparse
import doctest
import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from steer_by_wire import simulate
from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.command import main
from steer_by_wire.controller.analysis import jitter
from steer_by_wire.tools.dialect import __main__ as dialect_program
from tests.support.programs.running_program import ORDINARY
from tests.support.suite.shown_blocks import (
    LIVE,
    PAGES,
    RIG_ALONE,
    ROOT,
    Command,
    blocks_of,
    commands_of,
)
from tests.support.suite.unrendered import unrendered as unrendered

GIVEN = {
    "car.dbc": 'BU_: A B\nBO_ 1281 SPEED: 8 A\n SG_ V : 0|16@1+ (1,0) [0|0] "" B\n'
    'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;\nBA_ "GenMsgCycleTime" BO_ 1281 50;\n',
    "candump.log": "(1.000000) vcan0 110#7D33071027009CFF\n",
    "recording.log": "(1.000000) can0 123#DEADBEEF\n",
    "out/car/vehicle.toml": "",
    "steer.key": "000102030405060708090a0b0c0d0e0f\n",
    **{
        file.name: file.read_text(encoding="utf-8")
        for file in (ROOT / "tests" / "dbc" / "dialect").glob("my_car.*")
    },
    **{
        f"out/van/{file.name}": file.read_text(encoding="utf-8")
        for file in Path(__file__).with_name("van").glob("*.toml")
    },
}
"""Files of the reader's that pages name; ``design`` of lesson 8 writes those of the van, and
``identify`` that of the car."""
OF_NODES = (
    "docs/can_wire.md",
    *(f"docs/learn/{it}.md" for it in ("6_measuring", "8_your_car", "12_at_the_limit")),
)
"""Pages that show signals, or a bus, that compiled runs do not have; the others show the same
numbers with these (tests/closed_loop/compiled)."""
SHORT_S = 3.0
"""Duration of what only has to run: tests of each program let it run for a minute."""


@pytest.fixture(scope="module")
def broker() -> Iterator[str]:
    with launched_broker(["--data-bitrate", "2000000"]) as address:
        yield address


@pytest.fixture
def _folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("closed_loop", "controller", "dbc", "examples", "steer_by_wire", "tools"):
        (tmp_path / name).symlink_to(ROOT / name)
    for name, text in GIVEN.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
        (tmp_path / name).chmod(0o600)
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("_folder", "unrendered")
@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_shows_runs(
    page: str, broker: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    python, printed = doctest.DocTestRunner(), ""
    names: dict[str, object] = {}
    blocks = [*blocks_of(PAGES[page])]
    monkeypatch.setattr(dialect_program, "MOTION_S", SHORT_S)
    if page not in OF_NODES:
        defaults = {**(simulate.__kwdefaults__ or {}), "engine": "compiled"}
        monkeypatch.setattr(simulate, "__kwdefaults__", defaults)
    if not any("jitter" in block.text for block in blocks):  # most of the time of a check
        monkeypatch.setattr(jitter, "MEANS_MS", ())
    for block, following in zip(blocks, [*blocks, None][1:], strict=True):
        if block.file:
            Path(block.file).parent.mkdir(parents=True, exist_ok=True)
            Path(block.file).write_text(block.text, encoding="utf-8")
        elif block.language == "pycon":
            test = doctest.DocTestParser().get_doctest(block.text, names, page, page, 0)
            python.run(test, clear_globs=False)
            names = test.globs
            assert python.summarize(verbose=False).failed == 0
        elif block.language == "sh":
            commands = list(commands_of(block.text))
            is_shown = following is not None and following.language == "text"
            for command in commands:
                run(command, broker, monkeypatch, is_shown=is_shown)
            printed = capsys.readouterr().out
            if any(it.why_not or it.words[:1] in LIVE for it in commands):
                printed = ""
        elif block.language == "text" and printed:
            assert [line for line in block.text.splitlines() if line not in printed] == []


def run(command: Command, broker: str, monkeypatch: pytest.MonkeyPatch, *, is_shown: bool) -> None:
    """Run a command, or have its program parse it."""
    for name, value in command.settings.items():
        monkeypatch.setenv(name, value)
        monkeypatch.syspath_prepend(os.path.abspath(value))
    if command.why_not:
        if command.is_ours:
            parse(command, monkeypatch)
    elif command.words[:3] == ("python", "-m", "pytest"):
        assert pytest.main([*command.words[3:], *RIG_ALONE]) == 0
    elif command.words[-1:] == ("--preset",):  # lists them as soon as it is parsed
        parse(command, monkeypatch)
    elif command.words[:1] in LIVE and "--check" not in command.words:
        bus = ("-i", "emulated", "-c", "pages", "--bus-kwargs", f"address={broker}")
        status = main([*command.words, *ORDINARY, "--duration", "0.05", *bus])
        assert status in (0, 6)
    elif command.words:
        is_judged = is_shown or {"--duration", "--fail-if"} & {*command.words}
        brief = () if is_judged or command.words[0] != "run" else ("--duration", f"{SHORT_S}")
        assert main([*command.words, *brief]) == 0, command.line


def parse(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    parse_args = argparse.ArgumentParser.parse_args

    def only_parse(parser: argparse.ArgumentParser, words: list[str]) -> None:
        parse_args(parser, words)
        raise SystemExit(0)

    with monkeypatch.context() as patch:
        patch.setattr(argparse.ArgumentParser, "parse_args", only_parse)
        with pytest.raises(SystemExit) as end:
            main(command.words)
    assert end.value.code == 0, command.line


def test_every_lesson_has_an_exercise_whose_answer_runs() -> None:
    lessons = {page: text for page, text in PAGES.items() if re.search(r"learn/\d", page)}
    assert len(lessons) >= 8
    for page, text in lessons.items():
        _, _, exercise = text.partition("\n## Exercise\n")
        question, _, answer = exercise.partition("<summary>Answer</summary>")
        assert "?" in question or "Write" in question, page
        assert {"pycon", "sh"} & {block.language for block in blocks_of(answer)}, page
