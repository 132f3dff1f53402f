"""Completion in the shell within a tenth of a second: what parsers know is kept in a file.

argcomplete starts the program at every key, and its imports take seconds. The first key behind a
program's name still does; its options and their values then lie in the user's cache, by program,
until a file of the package changes. Standard library only.
"""

import json
import os
import re
import shlex
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import __version__

if TYPE_CHECKING:
    from argparse import Action, ArgumentParser

NO_SPACE = "="
"""Behind the key of a setting there is a value."""


def keep(program: str, parser: "ArgumentParser") -> None:
    """Keep what a parser knows."""
    from .runtime.output_file import write_text

    file = _file(program)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        for former in file.parent.glob(f"*-{program}.json"):
            former.unlink(missing_ok=True)
        write_text(file, json.dumps(_known(parser)))
    except OSError:
        return  # slow, but right


def _known(parser: "ArgumentParser") -> dict[str, Any]:
    """Return options and values of a parser, and the same of each of its commands."""
    import argparse

    options = {
        option: None if action.nargs == 0 else _values(action)
        for action in parser._actions
        for option in action.option_strings
        if option.startswith("--") and action.help != argparse.SUPPRESS
    }
    places = parser._get_positional_actions()
    commands = {
        name: _known(command)
        for action in places
        if isinstance(action, argparse._SubParsersAction)
        for name, command in action.choices.items()
    }
    values = [value for action in places for value in _values(action)]
    return {"options": options, "places": values, "commands": commands}


def answer_from_cache(program: str, line: str) -> bool:
    """Answer bash's request if what the program knows is kept; returns whether it was."""
    try:
        known = json.loads(_file(program).read_text(encoding="utf-8"))
        words = shlex.split(line)
    except (OSError, ValueError):
        return False
    last = "" if line.endswith(" ") else words.pop()
    known = next((known["commands"][word] for word in words if word in known["commands"]), known)
    found = list(_candidates(known, words[-1], last))
    if not found:
        return False
    if "=" in last and "=" in os.environ.get("_ARGCOMPLETE_COMP_WORDBREAKS", ""):
        # To bash what stands behind the sign is a word.
        found = [each.rpartition("=")[2] for each in found]
    end = " " if len(found) == 1 and not found[0].endswith(NO_SPACE) else ""
    escaped = [re.sub(r"([\s'\"()&;<>|$`\\])", r"\\\1", each) + end for each in found]
    _write(os.environ.get("_ARGCOMPLETE_IFS", "\v").join(escaped))
    return True


def _candidates(known: dict[str, Any], before: str, last: str) -> Iterator[str]:
    values = known["options"].get(before)
    if values is None:
        values = known["options"] if last.startswith("-") else known["places"]
    yield from offered(values, last)


def offered(values: Iterable[str], last: str) -> list[str]:
    """Return what may follow: the values of a setting only once its key is complete."""
    return [
        value
        for value in values
        if value.startswith(last) and ("=" in last or "=" not in value.rstrip(NO_SPACE))
    ]


def _values(action: "Action") -> list[str]:
    values = getattr(action.type, "values", None) or getattr(action, "values", None)
    return [*map(str, action.choices or ())] if values is None else list(values())


def offer_values(parser: "ArgumentParser") -> None:
    """Let argcomplete know the values too."""
    for action in parser._actions:
        if values := _values(action):
            completer = partial(_offered, values)
            setattr(action, "completer", completer)  # noqa: B010


def _offered(values: list[str], prefix: str = "", **_: object) -> list[str]:
    return offered(values, prefix)


def _file(program: str) -> Path:
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    package = Path(__file__).parent
    newest_ns = max(
        os.stat(os.path.join(folder, name)).st_mtime_ns
        for folder, _, names in os.walk(package, followlinks=True)
        for name in names
        if name.endswith((".py", ".toml"))
    )
    stamp = f"{__version__}-{newest_ns}-{program}.json"
    return base / "steer-by-wire-emulator" / "completion" / stamp


def _write(text: str) -> None:
    name = os.environ.get("_ARGCOMPLETE_STDOUT_FILENAME")
    with open(name or 8, "wb", closefd=bool(name)) as stream:
        stream.write(text.encode())
