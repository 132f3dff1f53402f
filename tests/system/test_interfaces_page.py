"""The commands that docs/interfaces.md shows are ones the programs take."""

import re
import shlex
from pathlib import Path
from typing import Any

import can
import pytest

from steer_by_wire.controller import program as controller_program
from steer_by_wire.plant_emulator import program as plant_program

PAGE = Path(__file__).resolve().parents[2] / "docs" / "interfaces.md"
PROGRAMS: dict[str, Any] = {
    "plant-emulator": plant_program,
    "steering-controller": controller_program,
}
COMMANDS = [
    line
    for block in re.findall(r"```\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    for line in block.splitlines()
    if line.split()[0] in PROGRAMS
]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_is_accepted(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    program, *arguments = shlex.split(command)
    module = PROGRAMS[program]
    asked: list[Any] = []

    def run_node(_name: str, options: Any, *_more: object, **_named: object) -> int:
        asked.append(options)
        return 0

    monkeypatch.setattr(module, "run_secured_node", run_node)
    assert module.main(arguments) == 0
    (options,) = asked
    assert options.interface in can.VALID_INTERFACES


def test_every_interface_is_shown_with_both_programs() -> None:
    shown = {(command.split()[0], command.split("-i ")[1].split()[0]) for command in COMMANDS}
    interfaces = {interface for _, interface in shown}
    assert {"socketcan", "slcan", "pcan", "kvaser", "vector", "socketcand"} < interfaces
    assert shown == {(program, interface) for program in PROGRAMS for interface in interfaces}
