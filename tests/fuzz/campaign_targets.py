"""Random specifications of a fault campaign, and random bytes as the results of an earlier one.

A specification is rejected as settings are, or every run of it can be made and begins.
Complete results are read, and all tables and pages can be made of them. They read the same after
they have been written again.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any

from steer_by_wire.closed_loop.reports.findings import finding_lines
from steer_by_wire.dbc.messages import MESSAGE_TYPES
from steer_by_wire.plant_emulator.faults.settings import FaultKind
from steer_by_wire.runtime.settings import Settings, load_settings
from steer_by_wire.tools.faults.campaign.acceptance import findings_of
from steer_by_wire.tools.faults.campaign.campaign_file import (
    CampaignSettings,
    CaseSettings,
    NodeCaseSettings,
    NodeFaultKind,
    PointSettings,
)
from steer_by_wire.tools.faults.campaign.campaign_runs import scenarios_of
from steer_by_wire.tools.faults.campaign.case_groups import group
from steer_by_wire.tools.faults.campaign.execution import RESULTS, keep_only, read_stored
from steer_by_wire.tools.faults.campaign.presentation import campaign_page, table_lines, write_csv
from steer_by_wire.tools.faults.campaign.virtual_trial import Detection, RunResult, run_trial
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
_CHANGED: Sequence[Callable[[Choices], Any]] = (
    Choices.number,
    lambda choices: choices.text().encode("utf-8", errors="replace").decode(),
    lambda choices: choices.integer(-(2**70), 2**70),
    lambda choices: choices.pick((None, True, [], {}, [1, "a"], {"plant.lost": None}, [[]])),
    lambda choices: choices.pick([*Detection]),
    lambda choices: [choices.integer(0, 9) for _ in range(choices.integer(0, 3))],
)


@lru_cache
def whole_result() -> RunResult:
    """Return the result of a short run without a fault."""
    spec = CampaignSettings(motion_s=1.0, onset_s=0.5, fault_s=0.1)
    return run_trial(next(iter(scenarios_of(spec))))


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


def fuzz_results(data: bytes) -> None:
    """Read results, and use them in every way a campaign does."""
    choices = Choices(data)
    with TemporaryDirectory() as inside:
        now = Path(inside)
        lines = [_line(choices) for _ in range(choices.integer(0, LINES_MAX))]
        (now / RESULTS).write_bytes(b"\n".join(lines))
        results = [result for _, result in read_stored(now, "a").results]
        keep_only(now, "a", results)
        again = [result for _, result in read_stored(now, "a").results]
        assert again == results, f"{results} become {again}"
        write_csv(now / "results.csv", results)
    _present(results)


def _present(results: Sequence[RunResult]) -> None:
    groups = group(results)
    findings = findings_of(results, 150.0)
    lines = [*table_lines(groups), *finding_lines(findings)]
    for line in lines:
        assert not line or line.isprintable(), f"not printable: {line!r}"
    campaign_page(CampaignSettings(), results, groups, findings, [])


def _line(choices: Choices) -> bytes:
    if choices.chance(48):
        return choices.raw(choices.integer(0, 40))
    record: dict[str, Any] = {"specification": choices.pick(("a", "b")), **whole_result()._asdict()}
    for _ in range(choices.integer(0, 3)):
        record[choices.pick([*record])] = choices.pick(_CHANGED)(choices)
    if choices.chance(16):
        del record[choices.pick([*record])]
    line = json.dumps(record).encode()
    return line[: choices.integer(0, len(line))] if choices.chance(16) else line


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
