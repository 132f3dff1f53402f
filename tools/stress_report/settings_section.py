"""The first section of the page: the settings of the study, and how its runs ended."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.verdict import VerdictRules
from ...reports.page import Cell, Section, Table, number
from ...runtime.settings import Settings
from ...studies.base_tables import leaves
from ...studies.verdict import short_windows
from .results import VERDICTS, FactorRecord, Rows, StudyRecord

_LABELS_SHOWN = 16
_DURATION = "plant.duration_s"


def study_section(study: StudyRecord, rows: Rows) -> Section:
    """Return the settings of the study, and how its runs ended."""
    sampling, runs = study.sampling, len(rows.id)
    size = f"{runs:,} runs" if runs == study.runs else f"{runs:,} of {study.runs:,} runs so far"
    texts = {
        "Size": f"{size}: {len(study.names)} controllers, {sampling['replicates']:,} replicates",
        "Points": f"{study.runs // len(study.names) // sampling['replicates']:,}, "
        f"{sampling['kind']}",
        "Seed": f"{sampling['seed']}; all controllers meet the same networks",
        "Arithmetic": "reordered and fused (--fastmath); worst runs and break-points are exact"
        if study.fastmath
        else "that of the nodes, to the last bit",
        "Controllers": ", ".join(study.names),
        **{f"Factor {factor.name}": _factor(factor) for factor in study.factors},
    }
    settings = Table(
        ("Setting", "Value"),
        [
            *((Cell(name), Cell(text)) for name, text in texts.items()),
            (Cell("Verdict"), _against(study.verdict, VerdictRules())),
            (Cell("Base of the plant"), _against(study.plant, PlantSettings())),
        ],
    )
    counts = np.zeros((len(study.names), len(VERDICTS)), dtype=np.int64)
    np.add.at(counts, (rows.controller, rows.verdict), 1)
    verdicts = Table(
        ("Controller", *map(str, VERDICTS)),
        [
            (Cell(name), *(number(f"{count:,}") for count in line))
            for name, line in zip(study.names, counts.tolist(), strict=True)
        ],
    )
    title = study.title or "Latency and jitter, law by law"
    return Section(title, (), tables=(settings, verdicts), notes=_warnings(study, rows))


def _factor(factor: FactorRecord) -> str:
    keys = ", ".join(factor.keys)
    labels = [f"{label:g}" if isinstance(label, float) else str(label) for label in factor.labels]
    if not labels:
        return f"{keys}: drawn"
    shown = labels if len(labels) <= _LABELS_SHOWN else [*labels[:8], "...", *labels[-3:]]
    return f"{keys}: {', '.join(shown)}"


def _against(tables: Mapping[str, Any], defaults: Settings) -> Cell:
    """Return the settings that differ from the defaults, and all of them to unfold."""
    usual = dict(leaves(defaults.model_dump(mode="json", exclude_none=True)))
    values = [(key, value) for key, value in leaves(tables) if value not in ([], {}, None)]
    differing = [(key, value) for key, value in values if usual.get(key) != value]
    return Cell(_texts(differing) or "all as by default", folded=_texts(values))


def _texts(values: list[tuple[str, Any]]) -> str:
    return "; ".join(
        f"{key} = {json.dumps(value) if isinstance(value, list) else value}"
        for key, value in values
    )


def _warnings(study: StudyRecord, rows: Rows) -> list[str]:
    durations_s = [float(study.plant["duration_s"])]
    for factor in study.factors:
        if _DURATION in factor.keys:
            durations_s = [float(np.min(rows.factors[factor.name]))]
    warning = short_windows(VerdictRules.model_validate(study.verdict), min(durations_s))
    return [f"Warning: {warning}."] if warning else []
