"""The pages of the documentation, their code blocks, and what each command in them is.

``sh``      commands, run in order in a folder of the page's own, which has the repository's folders
``pycon``   Python and what it prints, in one namespace for the page
``text``    behind commands that were run: lines of what they printed; otherwise only shown
others      a file, if the first line is a comment with its name; otherwise only shown
"""

import re
import shlex
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[3]
MADE = ("generated", "gallery", "_build")
PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in [*sorted(ROOT.glob("docs/**/*.md")), *sorted(ROOT.glob("*.md"))]
    if not {*path.parts} & {*MADE, "CHANGELOG.md"}
}
"""The text of each page, by its place."""
PROGRAMS = {"with-vcan": ("with-vcan",), "tools/with_vcan": ("with-vcan",), "steer-by-wire": ()}
"""The first word of a command of ours, and what stands for it behind ``steer-by-wire``."""
SHOWN_ONLY = ("c", "text", "ini", "toml", "yaml")
LIVE = (("plant",), ("controller",))
"""Programs that end after ``--duration`` on a bus."""
WHY_NOT = (
    (r" -i (?!emulated)|vcan0|^with-vcan|--fd", "needs a CAN interface"),
    (r"^(bus|cockpit|monitor) ?", "goes on in real time"),
    (
        r"^faults (?!--list)|FOLDER|drive\.csv|out/car|out/gains|out/study|--controller-command",
        "needs something of the reader's",
    ),
    (r"^(demo|design|paper|study(?! --list))", "takes minutes"),
)
"""Patterns of commands that are not run, and why; the first that matches counts."""
RIG_ALONE = (
    *("--disable-plugin-autoload", "-p", "steer_by_wire.closed_loop.pytest_plugin"),
    *("-p", "no:cacheprovider"),
)
"""Options for a pytest within this one."""
FURTHER = re.compile(r"[|&;>()]+|2>")
"""What begins another command in the shell, or sends the output elsewhere."""


class Block(NamedTuple):
    """A fenced block; ``file`` is the name in its first line, or empty."""

    language: str
    text: str
    file: str


class Command(NamedTuple):
    """A line of a block of commands.

    ``words``    behind ``steer-by-wire`` if it is ours, otherwise all
    ``settings`` of the environment
    ``why_not``  why it is not run; empty: it is
    """

    line: str
    words: tuple[str, ...]
    settings: dict[str, str]
    is_ours: bool
    why_not: str


def blocks_of(page: str) -> Iterator[Block]:
    """Return the fenced blocks of a page in order."""
    for language, text in re.findall(r"^```(\S*)[^\n]*\n(.*?)^```", page, re.DOTALL | re.MULTILINE):
        named = re.match(r"# (\S+\.\w+)\n", text)
        yield Block(language, text, named[1] if named and language != "sh" else "")


def commands_of(text: str) -> Iterator[Command]:
    """Return the commands of a block."""
    for line in text.replace("\\\n", " ").splitlines():
        bare = re.sub(r"(^|\s)# .*", "", line).strip()
        if bare:
            yield _command(bare)


def _command(line: str) -> Command:
    quoted = shlex.shlex(line, posix=True, punctuation_chars="|&;>()")
    quoted.whitespace_split, quoted.commenters = True, ""
    all_words = list(quoted)
    words = list(takewhile(lambda word: not FURTHER.fullmatch(word), all_words))
    has_more = len(words) < len(all_words)
    assigned = [word for word in words if re.match(r"[A-Z]+=", word)]
    settings = dict(word.split("=", 1) for word in assigned)
    words = [word for word in words if word not in assigned and word != "export"]
    is_ours = bool(words) and words[0] in PROGRAMS
    if is_ours:
        words = [*PROGRAMS[words[0]], *words[1:]]
    why_not = next((why for pattern, why in WHY_NOT if re.search(pattern, " ".join(words))), "")
    if has_more:
        why_not = "has something behind it in the shell"
    elif words and not is_ours and words[:3] != ["python", "-m", "pytest"]:
        why_not = "is another program"
    return Command(line, tuple(words), settings, is_ours, why_not)
