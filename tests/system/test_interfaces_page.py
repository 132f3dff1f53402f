"""docs/interfaces.md shows each kind of interface with both programs."""

from pathlib import Path

import can

from tests.support.suite.shown_blocks import blocks_of, commands_of

PAGE = Path(__file__).resolve().parents[2] / "docs" / "interfaces.md"
BOTH = ("plant", "controller")


def test_every_interface_is_shown_with_both_programs() -> None:
    shell = [
        block.text
        for block in blocks_of(PAGE.read_text(encoding="utf-8"))
        if block.language == "sh"
    ]
    commands = [command.words for text in shell for command in commands_of(text)]
    shown = {
        (words[0], words[words.index("-i") + 1])
        for words in commands
        if "-i" in words and words[0] in BOTH
    }
    interfaces = {interface for program, interface in shown if program == "plant"}
    assert {"socketcan", "slcan", "pcan", "kvaser", "vector", "socketcand"} < interfaces
    assert interfaces <= set(can.VALID_INTERFACES)
    assert shown == {(program, it) for program in BOTH for it in interfaces}
