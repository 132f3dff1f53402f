"""Report of a study: pictures as PNG, and one page with all of them."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...closed_loop.reports.page import Cell, Picture, Section, Table, number, page
from ...closed_loop.reports.plot_style import plot_style, png_of
from ...closed_loop.studies.base_settings import leaves
from ...closed_loop.studies.compiled_figures import short_windows
from ...closed_loop.studies.factors import Factor
from ...closed_loop.studies.result_files import are_numbers
from ...closed_loop.studies.result_reader import Rows, held, read_results
from ...closed_loop.studies.study import Study
from ...plant_emulator.evaluation.run_verdict import Verdict, VerdictRules
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import BoolArray, FloatArray
from ...runtime.output_file import write_file, write_text
from ...runtime.settings import Settings
from .against_pd import comparison_section
from .law_by_delay import (
    CURVES_MAX,
    LawByDelay,
    draw_error_over_delay,
    draw_largest_deviations,
    largest_deviations,
    law_by_delay,
    law_section,
)

_HEADINGS = (
    *("runs with a fault", "reported", "median, slowest [ms]"),
    *("control left", "median, slowest [ms]", "largest error [m]"),
)


def reaction_sections(study: Study, rows: Rows) -> list[Section]:
    """Return the section of the runs in which a fault changed a frame; none without such runs."""
    faulty = np.isfinite(rows["fault_s"])
    if not faulty.any():
        return []
    by_law = [(name, faulty & (rows["controller"] == name)) for name in study.names]
    tables = [_table("Controller", by_law, rows)]
    for factor in study.factors:
        if len(factor.labels) > 1:
            column = rows[factor.name]
            labels = dict.fromkeys(column[faulty].tolist())
            chosen = [(str(label), faulty & (column == label)) for label in labels]
            tables.append(_table(factor.name, chosen, rows))
    text = (
        "Times from the first frame that a fault changed: until CONTROLLER_SAFETY or PLANT_STATUS "
        "reported it, and until a command or the steering said that its node had left control. "
        "Runs in which no frame was changed are left out."
    )
    return [Section("Reactions to faults", (text,), tables=tables)]


def _table(what: str, chosen: list[tuple[str, BoolArray]], rows: Rows) -> Table:
    lines = [
        (
            Cell(name),
            number(str(int(np.count_nonzero(of)))),
            *_times(rows["reported_s"][of]),
            *_times(rows["reaction_s"][of]),
            number(f"{np.nanmax(rows['peak_m'][of]):.3f}"),
        )
        for name, of in chosen
        if of.any()
    ]
    return Table((what, *_HEADINGS), lines)


def _times(times_s: FloatArray) -> tuple[Cell, Cell]:
    """Return how many of the times there are, and their median and largest."""
    known_ms = 1e3 * times_s[np.isfinite(times_s)]
    if not len(known_ms):
        return number("0"), number("-")
    return number(str(len(known_ms))), number(f"{np.median(known_ms):.0f}, {known_ms.max():.0f}")


FELT_DELAY_NOT_KNOWN = (
    "not known with faults, a latency that varies or loses frames, or a law that needs no bus"
)


def hand_wheel_section(study: Study, rows: Rows) -> tuple[list[Section], list[str]]:
    """Return at which felt delays a hand wheel shakes, as a section and in lines to print."""
    if not study.hand_wheels:
        return [], []
    delay_ms, shakes = 1e3 * rows["felt_delay_s"], np.isfinite(rows["hand_wheel_shakes_hz"])
    reason = "" if study.bus is None else f"; felt delay {FELT_DELAY_NOT_KNOWN}"
    found, lines = [], []
    for factor in study.factors:
        for label in [] if factor.sets("plant.latency") else factor.labels:
            of, what = rows[factor.name] == label, f"{factor.name} {label}"
            count = f"{np.count_nonzero(of & shakes)} of {np.count_nonzero(of)}"
            still_ms, late_ms = (
                delay_ms[of & each & np.isfinite(delay_ms)] for each in (~shakes, shakes)
            )
            first_ms = late_ms.min(initial=np.inf)
            before_ms = still_ms[still_ms < first_ms]
            most = f"{before_ms.max():.1f}" if len(before_ms) else "-"
            least = f"{first_ms:.1f}" if len(late_ms) else "-"
            not_all = ", not in all runs" if len(before_ms) < len(still_ms) else ""
            found.append((Cell(what), *map(number, (count, most, least))))
            is_known = len(still_ms) + len(late_ms)
            felt = f"still up to {most} ms, shakes from {least} ms{not_all}"
            lines.append(f"{what}: {felt if is_known else f'{count} runs shake{reason}'}")
    table = Table(("Hand wheel", "shake", "still up to [ms]", "shakes from [ms]"), found)
    text = "By the felt delay: how old the wheel's angle is that the felt torque answers"
    text += "." if study.bus is None else f"; {FELT_DELAY_NOT_KNOWN}."
    return [Section("When the hand wheel shakes", (text,), tables=[table])], lines


PAGE = "report.html"


def write(folder: Path) -> tuple[Path, list[str]]:
    """Write page and pictures into the folder of the results.

    Returns the page, and lines: when a hand wheel shakes, the largest deviations of a study that
    prints them, and the grip.

    Raises SettingsError where there are no results, OSError where nothing can be written.
    """
    study, rows = read_results(folder)
    any_holds = held(rows).any()
    has_laws = any_holds or study.settings.report.largest_deviation
    found = law_by_delay(study, rows) if has_laws else None
    of_wheel, lines = hand_wheel_section(study, rows)
    used_up = _grip(study, rows)
    sections = [
        *of_wheel,
        study_section(study, rows, used_up),
        *reaction_sections(study, rows),
        *([] if found is None else [_laws(study, found, folder)]),
        *([comparison_section(study, rows)] if any_holds else []),
    ]
    file = folder / PAGE
    verdict = f"{np.count_nonzero(held(rows)):,} of {len(rows['id']):,} runs hold the path"
    if study.hand_wheels:
        shake = np.count_nonzero(np.isfinite(rows["hand_wheel_shakes_hz"]))
        verdict = f"the hand wheel shakes in {shake:,} of {len(rows['id']):,} runs"
    write_text(file, page(f"Study {study.settings.name}", sections, verdict))
    if found is None or not study.settings.report.largest_deviation:
        return file, [*lines, *used_up]
    return file, [*lines, *largest_deviations(found), *used_up]


def _laws(study: Study, found: LawByDelay, folder: Path) -> Section:
    names = (study.settings.report.error_over_delay or found.controllers)[:CURVES_MAX]
    laws = {name: str(tables["law"]) for name, tables in study.controllers.items()}
    draw = (
        draw_largest_deviations
        if study.settings.report.largest_deviation
        else draw_error_over_delay
    )
    with plot_style():
        png = png_of(draw(found, names, laws))
    write_file(folder / "error_over_delay.png", png)
    return law_section(found, [Picture(png, "error over delay")])


_LABELS_SHOWN = 16
_DURATION = "plant.duration_s"


def study_section(study: Study, rows: Rows, notes: Sequence[str]) -> Section:
    """Return the settings of the study, and how its runs ended, with ``notes`` below."""
    sampling, runs = study.settings.sampling, len(rows["id"])
    size = f"{runs:,} runs" if runs == study.runs else f"{runs:,} of {study.runs:,} runs so far"
    texts = {
        "Size": f"{size}: {len(study.names)} controllers, replicates: {sampling.replicates:,}",
        "Points": f"{study.design.points:,}, {sampling.kind}",
        "Seed": f"{sampling.seed}; all controllers meet the same networks",
        "Arithmetic": "that of the nodes, to the last bit",
        "Controllers": ", ".join(study.names),
        **{f"Factor {factor.name}": _factor(factor) for factor in study.factors},
    }
    settings = Table(
        ("Setting", "Value"),
        [
            *((Cell(name), Cell(text)) for name, text in texts.items()),
            (
                Cell("Verdict"),
                _against(study.settings.verdict.model_dump(mode="json"), VerdictRules()),
            ),
            (Cell("Base of the plant"), _against(study.plant, PlantSettings())),
        ],
    )
    of_verdict = {verdict: rows["verdict"] == verdict for verdict in Verdict}
    verdicts = Table(
        ("Controller", *map(str, Verdict)),
        [
            (
                Cell(name),
                *(
                    number(f"{np.count_nonzero(of & (rows['controller'] == name)):,}")
                    for of in of_verdict.values()
                ),
            )
            for name in study.names
        ],
    )
    title = study.settings.title or "Latency and jitter, law by law"
    return Section(title, (), tables=(settings, verdicts), notes=[*_warnings(study, rows), *notes])


def _grip(study: Study, rows: Rows) -> list[str]:
    """Return the sentence that names the grip; none where no run has used it up."""
    used = rows["controller"][np.isfinite(rows["grip_used_s"])].tolist()
    runs = {name: used.count(name) for name in study.names if name in used}
    named = ", ".join(f"{name} {count:,}" for name, count in runs.items())
    found = f"Runs that left the lane once the tyres had used up their grip: {named}."
    return [found] if named else []


def _factor(factor: Factor) -> str:
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


def _warnings(study: Study, rows: Rows) -> list[str]:
    durations_s = [float(study.plant["duration_s"])]
    for factor in study.factors:
        if _DURATION in factor.keys and are_numbers(factor.labels):
            durations_s = [float(np.min(rows[factor.name]))]
    warning = short_windows(study.settings.verdict, min(durations_s))
    return [f"Warning: {warning}."] if warning else []
