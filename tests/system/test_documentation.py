"""Every settings file that the documentation shows is one that the programs take."""

import re
from pathlib import Path

import pytest

from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.settings import Preset, Settings, load_settings, preset_names

DOCS = Path(__file__).resolve().parents[2] / "docs"
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
    text = text.replace("`paper_corner_a` to `_d`", "".join(f"`paper_corner_{c}`" for c in "abcd"))
    assert [name for name in preset_names(f"{package}.presets") if f"`{name}`" not in text] == []
