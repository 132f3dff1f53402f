"""Random specifications of a fault campaign.

A specification is rejected as settings are, or every run of it can be made and begins.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType

from steer_by_wire.dbc.messages import MESSAGE_TYPES
from steer_by_wire.plant_emulator.faults.settings import FaultKind
from steer_by_wire.runtime.settings import Settings, load_settings
from steer_by_wire.tools.faults.campaign.campaign_file import (
    CampaignSettings,
    CaseSettings,
    NodeCaseSettings,
    NodeFaultKind,
    PointSettings,
)
from tests.fuzz.settings_targets import begin_campaign, settled, toml_value
from tests.fuzz.traffic import Choices

TABLES_MAX = 3
LINES_MAX = 8
_TABLES: Sequence[tuple[str, type[Settings]]] = (
    ("points", PointSettings),
    ("cases", CaseSettings),
    ("node_cases", NodeCaseSettings),
)
_WORDS: Mapping[str, Sequence[str]] = MappingProxyType(
    {
        "messages": (*MESSAGE_TYPES, "all"),
        "nodes": ("controller", "plant", "bus"),
        "signal": ("steer_rad", "lateral_error_m", "", "counter"),
        "name": ("a", "b", "a\nb"),
        "laws": ("practical_pd", "practical_predictor", "none"),
    }
)
"""Valid values of some fields, and invalid ones."""


def fuzz_specification(data: bytes) -> None:
    """Read a specification whose tables are partly right, and begin runs of what is accepted."""
    choices = Choices(data)
    lines = [
        f"{choices.pick(sorted(CampaignSettings.model_fields))} = {toml_value(choices)}"
        for _ in range(choices.integer(0, TABLES_MAX) if choices.chance(64) else 0)
    ]
    for _ in range(choices.integer(0, TABLES_MAX)):
        name, model = choices.pick(_TABLES)
        lines += [f"[[{name}]]", *_table(choices, model)]
    with TemporaryDirectory() as folder:
        file = Path(folder) / "fuzzed.toml"
        file.write_text("\n".join(lines), encoding="utf-8", errors="replace")
        spec = settled(lambda: load_settings(CampaignSettings, file=file), (str(file), "settings"))
    if spec is not None:
        settled(lambda: begin_campaign(spec), ("preset ",))


def _table(choices: Choices, model: type[Settings]) -> list[str]:
    lines = []
    for key, field in model.model_fields.items():
        if field.is_required() or choices.chance(64):
            value = _value(choices, model, key) if choices.chance(248) else toml_value(choices)
            lines.append(f"{key} = {value}")
    return lines


def _value(choices: Choices, model: type[Settings], key: str) -> str:
    words = _WORDS.get(key, ())
    if key == "kind":
        words = (*FaultKind,) if model is CaseSettings else (*NodeFaultKind,)
    if key == "magnitudes":
        numbers = [choices.pick((1.0, 0.5, 3, 0.02, 0.3, choices.number())) for _ in range(2)]
        return repr(numbers[: choices.integer(1, 2)])
    if key in ("messages", "nodes", "laws"):
        return json.dumps([choices.pick(words) for _ in range(choices.integer(1, 2))])
    if words:
        return json.dumps(choices.pick(words))
    return repr(choices.pick((1.0, 5.0, 100.0, 1000, 0.5, 250.0, 100_000.0, choices.number())))
