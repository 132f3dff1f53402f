"""Names on the pages lead somewhere: settings, files, links, modules, commands.

Its site is built without a warning; its diagrams are those of their program.
"""

import re
import subprocess
import sys
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path

import can
import pytest
from docutils.utils.math.latex2mathml import tex2mathml

from steer_by_wire.command import PROGRAMS
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.settings import Preset, Settings, load_settings, preset_names
from tests.support.suite.shown_blocks import MADE, PAGES, ROOT, SHOWN_ONLY, blocks_of, commands_of

DOCS = ROOT / "docs"
SETTINGS_OF: dict[str, type[Settings]] = {
    "plant_emulator.md": PlantSettings,
    "controller.md": ControllerSettings,
}
EXAMPLES = [
    pytest.param(model, text, id=f"{name}-{index}")
    for name, model in SETTINGS_OF.items()
    for index, text in enumerate(
        re.findall(r"```toml\n(.*?)```", (DOCS / name).read_text(encoding="utf-8"), re.DOTALL)
    )
]


@pytest.mark.parametrize(("model", "text"), EXAMPLES)
def test_a_settings_file_in_the_documentation_is_accepted(model: type[Settings], text: str) -> None:
    load_settings(model, Preset("documentation", text))


def test_there_are_examples_of_both_programs() -> None:
    assert {example.values[0] for example in EXAMPLES} == set(SETTINGS_OF.values())


@pytest.mark.parametrize("package", ["controller", "plant_emulator"])
def test_every_preset_is_documented(package: str) -> None:
    text = (DOCS / f"{package}.md").read_text(encoding="utf-8")
    text = re.sub(r"`(\w+_corner)_a` to `_d`", r"`\1_a` `\1_b` `\1_c` `\1_d`", text)
    assert [name for name in preset_names(f"{package}.presets") if f"`{name}`" not in text] == []


# What documents name


def anchors(text: str) -> set[str]:
    """Return the anchors that GitHub makes of a page's headings."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ (.+)$", prose, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


Judged = Iterable[tuple[str, bool]]
"""What a page names, and whether it is right."""


def assert_right(judge: Callable[[str], Judged]) -> None:
    """Fail for what is wrong in a page, and if no page names anything."""
    judged = [(page, name, right) for page in PAGES for name, right in judge(page)]
    assert judged
    assert [(page, name) for page, name, right in judged if not right] == []


def test_every_link_leads_somewhere() -> None:
    def links(page: str) -> Judged:
        for link in re.findall(r"\]\(([^)\s]+)\)", PAGES[page]):
            target, _, anchor = link.partition("#")
            path = (ROOT / page).parent / target if target else ROOT / page
            if link.startswith("https://"):
                continue
            # An anchor of another file is one of the page that the site makes of it.
            has_anchor = (
                not anchor
                or path.suffix != ".md"
                or anchor in anchors(path.read_text(encoding="utf-8"))
            )
            made = {*Path(link).parts} & {*MADE}  # on GitHub there is no such page
            yield link, path.exists() and has_anchor and not made

    assert_right(links)


def test_every_block_says_what_it_is() -> None:
    """Those of sh and pycon are run, and what is named in a first line is a file: test_pages."""

    def blocks(page: str) -> Judged:
        for block in blocks_of(PAGES[page]):
            if not block.file and not block.language.startswith("{"):
                yield block.language, block.language in {"pycon", "sh", *SHOWN_ONLY}

    assert_right(blocks)


def test_every_picture_has_words_in_its_place() -> None:
    def pictures(page: str) -> Judged:
        for words, file in re.findall(r"!\[(.*?)\]\(([^)]*)\)", PAGES[page], re.DOTALL):
            yield file, re.search(r"\w", words) is not None

    assert_right(pictures)


def test_every_file_of_ours_that_is_named_is_there() -> None:
    ours = "controller|dbc|docs|examples|plant_emulator|runtime|steer_by_wire|tests|tools"

    def files(page: str) -> Judged:
        for name in re.findall(rf"(?<![\w./-])((?:{ours})/[\w./-]*\w)", PAGES[page]):
            yield name, (ROOT / name).exists() or bool({*Path(name).parts} & {*MADE})

    assert_right(files)


def test_every_module_that_is_named_can_be_imported() -> None:
    def modules(page: str) -> Judged:
        named = set(re.findall(r"\bsteer_by_wire(?:\.\w+)+", PAGES[page]))
        for name in named:
            parts = name.split(".")
            module = next(
                (".".join(parts[:n]) for n in range(len(parts), 0, -1) if find_module(parts[:n])),
                "",
            )
            owner, attributes = import_module(module), parts[module.count(".") + 1 :]
            yield name, all(hasattr(owner, attribute) for attribute in attributes[:1])

    assert_right(modules)


def find_module(parts: list[str]) -> bool:
    place = ROOT.joinpath(*parts)
    return place.is_dir() or place.with_suffix(".py").is_file()


def test_every_command_that_is_named_is_one() -> None:
    def commands(page: str) -> Judged:
        command = re.compile(r"(?:^|`|vcan )steer-by-wire ([a-z][\w-]*)", re.MULTILINE)
        return ((name, name in PROGRAMS) for name in command.findall(PAGES[page]))

    assert_right(commands)


def test_a_container_is_removed_and_writes_into_a_folder_of_yours_as_you() -> None:
    """The image's own user may not."""

    def containers(page: str) -> Judged:
        for options in re.findall(r"^docker run (.+)", PAGES[page], re.MULTILINE):
            is_yours = ("$PWD" in options) == ("--user" in options)
            yield options, "--rm " in options and is_yours

    assert_right(containers)


def test_every_formula_can_be_drawn() -> None:
    def formulas(page: str) -> Judged:
        text = re.sub(r"```.*?```|`[^`\n]*`", "", PAGES[page], flags=re.DOTALL)
        for block, within_a_line in re.findall(r"\$\$(.*?)\$\$|\$([^$\n]+)\$", text, re.DOTALL):
            formula = block or within_a_line
            yield formula, tex2mathml(formula).startswith("<math")

    assert_right(formulas)


def test_every_interface_is_shown_with_both_programs() -> None:
    shell = [
        block.text for block in blocks_of(PAGES["docs/interfaces.md"]) if block.language == "sh"
    ]
    commands = [command.words for text in shell for command in commands_of(text)]
    shown = {
        (words[0], words[words.index("-i") + 1])
        for words in commands
        if "-i" in words and words[0] in ("plant", "controller")
    }
    interfaces = {interface for program, interface in shown if program == "plant"}
    assert {"socketcan", "slcan", "pcan", "kvaser", "vector", "socketcand"} < interfaces
    assert interfaces <= set(can.VALID_INTERFACES)
    assert shown == {(program, it) for program in ("plant", "controller") for it in interfaces}


BUILD = """
import gc, sys
from sphinx.cmd.build import main
gc.disable()  # what it makes, it keeps
sys.exit(main(sys.argv[1:]))
"""


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    """Pages that no other names, names that are not defined, and dead links are warnings."""
    options = ("-b", "dummy", "-q", "-n", "-W", "--keep-going")
    without = ("-D", "plot_gallery=0", "-D", "smartquotes=0")
    result = subprocess.run(
        [sys.executable, "-c", BUILD, *options, *without, DOCS, tmp_path],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr


def test_the_diagrams_are_those_of_their_program(tmp_path: Path) -> None:
    subprocess.run([sys.executable, DOCS / "diagrams.py", tmp_path], check=True)
    drawn = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert len(drawn) > 3
    assert drawn == {name: (DOCS / "images" / name).read_bytes() for name in drawn}
