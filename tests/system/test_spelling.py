"""Every word of the documents and docstrings is in a dictionary or in the project's own list."""

import re
from pathlib import Path

from spellchecker import SpellChecker

from tests.support.shown_blocks import PAGES, ROOT

OWN_WORDS = Path(__file__).with_name("words.txt").read_text(encoding="utf-8").splitlines()
"""Words of the field, names, and the British spelling of words that the dictionary spells as
Americans do."""
BRITISH = (("our", "or"), ("tre", "ter"), ("is", "iz"), ("ys", "yz"), ("oeu", "eu"))
CODE = re.compile(
    r"^```.*?^```|`[^`]*`|\]\([^)]*\)|https?://\S+|^ {4}[^\n]*",
    re.DOTALL | re.MULTILINE,
)
DOCSTRING = re.compile(r'(?:= |\()""".*?"""|"""(.*?)"""', re.DOTALL)
"""In its group; what is assigned or passed is another string."""
WORD = re.compile(r"(?<![\w./\\-])[A-Za-z][a-zà-ÿ]+(?:-[a-z]+|'t)*(?![\w=(/\\]|\.\w)")
"""No part of a path or of a name in code, and no abbreviation in capitals."""
FOLDERS = (
    *("closed_loop", "controller", "dbc", "plant_emulator", "runtime", "steer_by_wire"),
    "tools",
)
IN_FORMULAS = 4
"""The letters that a name in a formula or a table of a docstring has at most."""


def words_of(text: str) -> set[str]:
    prose = CODE.sub(" ", text)
    return {part for word in WORD.findall(prose) for part in word.lower().split("-")}


def documented_words() -> set[str]:
    words = words_of((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    words.update(*map(words_of, PAGES.values()))
    for folder in FOLDERS:
        for file in (ROOT / folder).rglob("*.py"):
            docstrings = DOCSTRING.findall(file.read_text(encoding="utf-8"))
            words |= {it for text in docstrings for it in words_of(text) if len(it) > IN_FORMULAS}
    return words


def test_every_word_is_in_the_dictionary_or_in_the_list() -> None:
    dictionary, words = SpellChecker(), documented_words()
    assert sorted(dictionary.unknown(words)) == OWN_WORDS
    american = {word.replace(*pair) for word in OWN_WORDS for pair in BRITISH} - {*OWN_WORDS}
    assert sorted(dictionary.known(american) & words) == []
