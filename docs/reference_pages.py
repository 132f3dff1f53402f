"""The generated pages: commands, settings with their ranges, messages, and the course's slides.

``docs/conf.py`` calls ``write_pages``; they go to ``docs/generated``, which git ignores.
"""

import contextlib
import inspect
import io
import json
import os
import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import get_args

from cantools.database.can import Message
from cantools.database.can.signal import Signal
from sphinx.pycode import ModuleAnalyzer

from steer_by_wire.command import GROUPS, NAME, start
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.dbc.codec.protection import header_bits
from steer_by_wire.dbc.contract.dbc_file import active_cycle_time_ms, load_database
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.settings import Settings
from steer_by_wire.runtime.settings.mistakes import allowed
from steer_by_wire.tools.design.specification import Specification

HELP_COLUMNS = "88"


def write_pages(folder: Path) -> None:
    """Write all generated pages; a file that stays the same is left alone."""
    folder.mkdir(exist_ok=True)
    pages = {
        "commands": commands_page(),
        "plant_settings": settings_page("plant emulator", PlantSettings),
        "controller_settings": settings_page("controller", ControllerSettings),
        "design_specification": settings_page("gain design's specification", Specification),
        "messages": messages_page(),
        "slides": slides_page(folder.parent / "learn"),
    }
    for name, text in pages.items():
        file = folder / f"{name}.md"
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def commands_page() -> str:
    """Return the help of every program, in the order of ``steer-by-wire --help``."""
    parts = ["# Commands\n\nWhat each command prints with `--help`.\n"]
    for group, programs in GROUPS.items():
        parts.append(f"## {group}\n")
        for name, program in programs.items():
            parts.append(f"### {NAME} {name}\n\n{program.summary}\n")
            helps = [_help(name), *(_help(name, one) for one in program.subcommands)]
            parts += [f"```text\n{text.rstrip()}\n```\n" for text in helps]
    return "\n".join(parts)


def _help(name: str, *words: str) -> str:
    printed = io.StringIO()
    os.environ["COLUMNS"] = HELP_COLUMNS
    with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
        start(name, [*words, "--help"])
    return printed.getvalue()


def settings_page(program: str, model: type[Settings]) -> str:
    """Return every table of a program's settings, each key with its range and default."""
    intro = (
        f"# Settings of the {program}\n\nEvery key of a settings file, and of"
        " `--set table.key=value`. The unit is the last part of a name.\n"
    )
    return "\n".join([intro, "## Keys outside a table\n", *_table(model, "")])


def _table(model: type[Settings], place: str) -> Iterator[str]:
    schema, rows, inner = model.model_json_schema(), [], []
    comments = ModuleAnalyzer.for_module(model.__module__).find_attr_docs()
    for key, field in model.model_fields.items():
        tables = list(_tables_in(field.annotation))
        inner += [(f"{place}.{key}".removeprefix("."), table) for table in tables]
        if not tables:
            default = "required" if field.is_required() else _shown(field.default)
            comment = " ".join(comments.get((model.__name__, key), ()))
            rows.append(f"| `{key}` | {allowed(schema, (key,))} | {default} | {comment} |")
    if model.__doc__ and place:
        yield f"```text\n{inspect.cleandoc(model.__doc__)}\n```\n"
    if rows:
        yield "\n".join(["| Key | Allowed | Default | |", "|---|---|---|---|", *rows, ""])
    for key, table in inner:
        kind_field = table.model_fields.get("kind")
        kind = get_args(kind_field.annotation) if kind_field else ()
        yield f"## `[{key}]`{f' with kind = {kind[0]}' if kind else ''}\n"
        yield from _table(table, key)


def _tables_in(annotation: object) -> Iterator[type[Settings]]:
    if isinstance(annotation, type) and issubclass(annotation, Settings):
        yield annotation
    for part in get_args(annotation):
        yield from _tables_in(part)


def _shown(default: object) -> str:
    return "" if default is None else f"`{json.dumps(default, default=str)}`"


def messages_page() -> str:
    """Return every message of the DBC with its signals: layout, range, meaning."""
    intro = (
        "# Messages and signals\n\nEvery message of `dbc/steer_by_wire.dbc`. Bits count from the"
        " lowest of byte 0; a payload is little-endian, signed signals are in two's complement."
        " Bytes 0 to 2 are the [E2E header](../wire_contract.md#protection-autosar-e2e-profile-5)"
        " where a message has a Data ID. The raw integer is the value over the number after *by*.\n"
    )
    messages = sorted(load_database().messages, key=lambda message: message.frame_id)
    head = "| Identifier | Message | From | Cycle |\n|---|---|---|---|"
    rows = [
        f"| [0x{one.frame_id:X}](#{one.name.lower()}-0x{one.frame_id:x}) | {one.name} |"
        f" {one.senders[0]} | {_cycle(one)} |"
        for one in messages
    ]
    return "\n".join([intro, head, *rows, "", *map(_message, messages)])


def _cycle(message: Message) -> str:
    if message.cycle_time:
        return f"{message.cycle_time} ms"
    active_ms = active_cycle_time_ms(message)
    return f"{active_ms} ms while it is sent" if active_ms else "none in the DBC"


def _message(message: Message) -> str:
    attributes = message.dbc.attributes if message.dbc else {}
    data_id = attributes.get("E2EDataId")
    header = header_bits(message.name)
    signals = [signal for signal in message.signals if signal.name not in header]
    used = {signal.start + bit for signal in message.signals for bit in range(signal.length)}
    unused = [bit for bit in range(8 * message.length) if bit not in used]
    facts = [
        f"From {message.senders[0]} to {', '.join(sorted(signals[0].receivers))}",
        f"cycle: {_cycle(message)}",
        f"{message.length} bytes{' of CAN FD' if message.is_fd else ''}",
        f"E2E Data ID 0x{data_id.value:X}" if data_id else "no E2E header",
        *([f"unused bits {', '.join(map(str, unused))}"] if unused else []),
    ]
    return "\n".join(
        [
            f"## {message.name} 0x{message.frame_id:X}\n\n{message.comment}\n",
            f"{'; '.join(facts)}.\n",
            "| Signal | Bits | Value | Meaning |\n|---|---|---|---|",
            *(_signals(list(alike)) for _, alike in groupby(signals, _series)),
            "",
        ]
    )


def _series(signal: Signal) -> str:
    """Return the name without a number at its end: those of one series are one row."""
    return re.sub(r"_\d+$", "_", signal.name)


def _signals(alike: list[Signal]) -> str:
    signal = alike[0]
    bits = ", ".join(f"{one.start} to {one.start + one.length - 1}" for one in alike[:2])
    step = f" by {signal.scale:g}" if signal.scale != 1 else ""
    choices = "; ".join(f"{raw} {text}" for raw, text in (signal.choices or {}).items())
    cells = (
        signal.name if len(alike) == 1 else f"{signal.name} to {alike[-1].name}",
        f"{bits}{', ...' if len(alike) > 2 else ''}{' signed' if signal.is_signed else ''}",
        f"{signal.minimum:.9g} to {signal.maximum:.9g} {signal.unit or ''}{step}",
        f"{signal.comment} {choices}".strip(),
    )
    return "|" + "".join(f" {cell} |" for cell in cells)


_QUESTION = re.compile(r"^\| \[[^]]+\]\((\w+\.md)\) \| (.+) \|$", re.MULTILINE)
_PICTURE = re.compile(r"^!\[.*\)$", re.MULTILINE)
_FORMULA = re.compile(r"^\$\$\n.*?^\$\$$", re.MULTILINE | re.DOTALL)
_EXAMPLE = re.compile(r"^```(?:pycon|sh|python)\n.*?^```$", re.MULTILINE | re.DOTALL)
_EXERCISE = re.compile(r"^## Exercise\n\n(.*?)\n\n", re.MULTILINE | re.DOTALL)


def slides_page(course: Path) -> str:
    """Return a slide of each lesson: question, picture, formulas, first example and exercise."""
    parts = ["# Slides\n\nOne a lesson, and one a sheet when the page is printed.\n"]
    for file, question in _QUESTION.findall((course / "index.md").read_text(encoding="utf-8")):
        text = (course / file).read_text(encoding="utf-8")
        title = text.partition("\n")[0].removeprefix("# ")
        shown = _PICTURE.findall(text)[:1] + _FORMULA.findall(text) + _EXAMPLE.findall(text)[:1]
        asked = _EXERCISE.findall(text)[:1]
        parts.append("\n\n".join([f"## {title}", f"**{question}**", *shown, *asked]) + "\n")
    return "\n".join(parts)
