"""Writes the report of a study: pictures as PNG, and one page with all of them."""

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from ...reports.page import Picture, Section, page
from ...reports.plot_style import plot_style, png_of
from .axes import StudyAxes, study_axes
from .break_point_picture import draw_break_points
from .break_points import SEEDS, break_points
from .comparison import comparisons
from .cost_check import cost_checks, draw_checks
from .heat_maps import draw_held, draw_rms, heat_maps
from .level_section import level_sections
from .results import Rows, StudyRecord, read_rows, read_study
from .sections import (
    break_point_section,
    comparison_section,
    cost_section,
    map_section,
    worst_section,
)
from .settings_section import study_section
from .worst_runs import draw_worst, worst_runs

PAGE = "report.html"


def write(folder: Path, break_point_seeds: int = SEEDS) -> Path:
    """Write page and pictures into the folder of the results; returns the page.

    Raises SettingsError where there are no results, OSError where nothing can be written.
    """
    study = read_study(folder)
    rows = read_rows(study)
    axes = study_axes(study, rows)
    sections = [
        study_section(study, rows),
        _maps(study, rows, axes),
        comparison_section(study, comparisons(study, rows)),
        *level_sections(study, rows, axes),
    ]
    if study.scenarios.study.bus is None:  # these run scenarios again, compiled
        sections.insert(2, _break_points(study, rows, axes, break_point_seeds))
        sections += [_worst(study, rows), _costs(study, rows, axes)]
    file = folder / PAGE
    file.write_text(page(f"Stress study {study.name}", sections), encoding="utf-8")
    return file


def _maps(study: StudyRecord, rows: Rows, axes: StudyAxes) -> Section:
    maps = heat_maps(rows, axes, len(study.names))
    pictures = [
        _save(study, "heat_map_rms", lambda: draw_rms(maps, axes, study.names)),
        _save(study, "heat_map_held", lambda: draw_held(maps, axes, study.names)),
    ]
    return map_section(axes, pictures)


def _break_points(study: StudyRecord, rows: Rows, axes: StudyAxes, seeds: int) -> Section:
    points = break_points(study, rows, axes, seeds)
    pictures = (
        [_save(study, "break_points", lambda: draw_break_points(points, axes, study.names))]
        if points
        else []
    )
    return break_point_section(study, axes, points, pictures)


def _worst(study: StudyRecord, rows: Rows) -> Section:
    found = worst_runs(study, rows)
    pictures = [_save(study, "worst_runs", lambda: draw_worst(study, found))] if found else []
    return worst_section(study, rows, found, pictures)


def _costs(study: StudyRecord, rows: Rows, axes: StudyAxes) -> Section:
    found = cost_checks(study, rows, axes)
    shown = [check for check in found.checks if check.is_random]
    pictures = [_save(study, "expected_cost", lambda: draw_checks(study, shown))] if shown else []
    return cost_section(study, found, pictures)


def _save(study: StudyRecord, name: str, draw: Callable[[], Figure]) -> Picture:
    with plot_style():
        png = png_of(draw())
    (study.folder / f"{name}.png").write_bytes(png)
    return Picture(png, name.replace("_", " "))
