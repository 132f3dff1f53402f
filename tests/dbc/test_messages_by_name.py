"""Messages on the bus are made and read by the names of their fields: a new one breaks nothing."""

import ast
from pathlib import Path

import pytest

import steer_by_wire
from steer_by_wire.dbc.messages import MESSAGE_TYPES

ROOT = Path(steer_by_wire.__file__).parent
FOLDERS = ("controller", "hand_wheel", "plant_emulator", "closed_loop", "tools", "dbc", "../tests")
NAMES = {kind.__name__ for kind in MESSAGE_TYPES.values()}


def made_by_position(text: str) -> list[int]:
    """Return the lines that make or unpack a message by position."""
    tree = ast.parse(text)
    imported = {
        name.asname or name.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and "dbc" in (node.module or "")
        for name in node.names
    }
    lines = []
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name(id=name), args=[_, *_]) if name in NAMES & imported:
                lines.append(node.lineno)
            case ast.Call(func=ast.Attribute(value=ast.Name(id="ours" | "messages"), attr=name)):
                if name in NAMES and node.args:
                    lines.append(node.lineno)
            case ast.Assign(
                targets=[ast.Tuple()], value=ast.Name(id="message" | "status" | "path")
            ):
                lines.append(node.lineno)
            case ast.Starred(value=ast.Name(id="message" | "error")):
                lines.append(node.lineno)
            case ast.Call(func=ast.Attribute(attr="frame"), args=[ast.Tuple(), *_]):
                lines.append(node.lineno)
    return lines


@pytest.mark.parametrize("folder", FOLDERS)
def test_messages_are_made_and_read_by_name(folder: str) -> None:
    files = [*(ROOT / folder).resolve().rglob("*.py")]
    assert files
    found = [
        f"{file.name}:{line}"
        for file in files
        for line in made_by_position(file.read_text(encoding="utf-8"))
    ]
    assert found == []


def test_the_search_finds_them() -> None:
    begin = "from ..dbc.messages import LateralError\n"
    assert made_by_position(begin + "LateralError(0.0, 0.0)") == [2]
    assert sorted(made_by_position("a, b = message\nf(*message)\nx.frame((0.0, 0.0))")) == [1, 2, 3]
