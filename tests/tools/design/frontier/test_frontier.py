"""The frontier: designs meet what they are compared at, with the errors that its page states."""

import csv
import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.filters.settings import QKind
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.runtime.settings import SettingsError, load_settings, read_preset
from steer_by_wire.tools.design.frontier import points
from steer_by_wire.tools.design.frontier.frontier import draw_frontier, write_csv
from steer_by_wire.tools.design.frontier.points import (
    Point,
    bench_for,
    designed_points,
    point_of,
    predictor_points,
    specification_for,
)
from steer_by_wire.tools.design.frontier.settings import (
    STRUCTURES,
    FrontierSettings,
    Panel,
    PanelTable,
    panels_of,
)
from steer_by_wire.tools.design.search.evolution import Values
from steer_by_wire.tools.design.search.law_parameters import controller_settings
from steer_by_wire.tools.design.vehicle_file import VehicleFile
from tests.support.suite.combinations import sampled
from tests.support.suite.curves import alike_without_colour

ROOT = Path(__file__).parents[4]
FOUND = {
    "PD, error alone": {"k_p": 0.57, "k_d": 0.0074, "derivative_filter": 227.0},
    "PID, error alone": {"k_p": 0.457, "k_d": 1.64, "derivative_filter": 0.533, "k_i": 0.00853},
    "PD": {"k_p": 1.48, "k_d": 0.0556, "derivative_filter": 32.3},
    "PD + map": {"k_p": 1.48, "k_d": 0.0528, "derivative_filter": 35.2},
    "PID": {"k_p": 1.24, "k_d": 0.142, "derivative_filter": 13.6, "k_i": 2.09},
    "PID + heading": {
        "k_p": 0.885,
        "k_d": 0.0491,
        "derivative_filter": 25.8,
        "k_i": 0.92,
        "k_heading": 1.65,
    },
    "PD + DDOB": {
        "k_p": 0.954,
        "k_d": 0.184,
        "derivative_filter": 11.9,
        "dob": 1.3,
        "cdob": 0.141,
        "washout": 0.329,
    },
}
"""By ``steer-by-wire design paper_vehicle --frontier frontier``, for 250 ms."""

AT_60_KM_H = {
    "k_p": 0.0367,
    "k_d": 0.00425,
    "derivative_filter": 20.0,
    "k_i": 0.0296,
    "k_heading": 0.451,
}
"""PID + heading, by the same command, for 200 ms."""

TRIED = sampled(["PD, error alone", "PID + heading"], [*FOUND])

Q_KIND: QKind = "type_2"
"""The better filter of the DDOB at 250 ms; other structures have none."""


def asked(*overrides: str) -> FrontierSettings:
    preset = read_preset("steer_by_wire.tools.design.frontier", "frontier")
    return load_settings(FrontierSettings, preset, overrides=overrides)


def vehicle() -> VehicleFile:
    return load_settings(VehicleFile, read_preset("steer_by_wire.tools.design", "paper_vehicle"))


@cache
def whole() -> Panel:
    """Of the page, not quick."""
    return panels_of(asked(), vehicle())[0]


def quick(delays_ms: Sequence[float], duration_s: float, *overrides: str) -> Panel:
    """Return the panel at walking speed for one vehicle, with short runs."""
    alone = VehicleFile(vehicle=vehicle().vehicle)
    (settings, table, _), *_ = panels_of(asked(*overrides), alone)
    course = table.course.model_copy(update={"duration_s": duration_s})
    changed = {"delays_ms": tuple(delays_ms), "course": course}
    changed |= {"search": None, "predictor_generations": None}
    return Panel(settings, table.model_copy(update=changed), alone)


@cache
def point(structure: str) -> Point:
    """Of the page."""
    fine = bench_for(whole(), structure, 250.0, True, Q_KIND)
    return point_of(whole(), fine, structure, FOUND[structure])


@pytest.mark.parametrize("structure", TRIED)
def test_each_design_meets_the_demands_that_make_the_comparison_fair(structure: str) -> None:
    found = point(structure)
    assert found.noise_gain_rad_m <= 3.2
    assert found.peak_sensitivity <= 2.9
    assert found.margin_ms >= 1.3 * found.delay_ms


def test_the_margin_is_where_a_corner_becomes_unstable() -> None:
    law = STRUCTURES["PID + heading"].law
    spec = specification_for(whole(), "PID + heading", 250.0)
    design = design_law(controller_settings(spec, vehicle(), law, FOUND["PID + heading"]))
    loops = [SampledLoop(design, model, spec.period_ns) for model in vehicle().models]
    margin_ms = point("PID + heading").margin_ms
    before_ns, after_ns = (round(1e6 * (margin_ms + step)) for step in (-1.0, 1.0))
    assert all(loop.is_stable(before_ns) for loop in loops)
    assert not all(loop.is_stable(after_ns) for loop in loops)


@pytest.mark.parametrize("structure", TRIED)
def test_the_page_states_the_errors_that_the_designs_have(structure: str) -> None:
    page = (ROOT / "docs/frontier.md").read_text(encoding="utf-8")
    row, _ = [line.split("|") for line in page.splitlines() if line.startswith(f"| {structure} |")]
    assert stated_mm(row[4]) == pytest.approx(figures_mm(point(structure)), rel=0.01)


def test_the_page_states_the_errors_at_60_km_h() -> None:
    page = (ROOT / "docs/frontier.md").read_text(encoding="utf-8")
    *_, row = [line.split("|") for line in page.splitlines() if "| PID + heading |" in line]
    panel = panels_of(asked(), vehicle())[1]
    fine = bench_for(panel, "PID + heading", 200.0, True)
    found = point_of(panel, fine, "PID + heading", AT_60_KM_H)
    assert stated_mm(row[3]) == pytest.approx(figures_mm(found), rel=0.01)
    assert found.noise_gain_rad_m <= 0.28
    assert found.peak_sensitivity <= 2.9


def stated_mm(cell: str) -> list[float]:
    return [float(figure) for figure in cell.split("/")]


def figures_mm(found: Point) -> list[float]:
    return [1e3 * found.rms_m, 1e3 * found.noisy_rms_m]


def test_a_short_search_for_one_vehicle_finds_less_error_than_the_design_for_its_box() -> None:
    panel = quick([250.0], 6.0, "search.generations=25", "search.starts=1")
    (found,) = designed_points(panel, "PD")
    fine = bench_for(panel, "PD", 250.0, True)
    assert found.rms_m <= 0.8 * point_of(panel, fine, "PD", FOUND["PD"]).rms_m


def test_of_the_filters_of_a_dob_the_better_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """And each search goes on from the design of its own filter for the longer delay."""
    begun: list[tuple[QKind, Values | None]] = []

    def bench_of(_panel: object, _structure: str, *where: object) -> object:
        delay_ms, _, q_kind = where
        return SimpleNamespace(delay_ms=delay_ms, q_kind=q_kind)

    def find(_coarse: object, fine: Any, _law: str, _done: object, near: Values | None) -> object:
        begun.append((fine.q_kind, near))
        values = {"k_p": fine.delay_ms + (fine.q_kind == "order_2")}
        return SimpleNamespace(ended=True, feasible=True, values=values, judged=1)

    def point_of(_asked: object, fine: Any, structure: str, *_: object) -> Point:
        is_better = (fine.q_kind == "order_2") == (fine.delay_ms == 250.0)
        rms_m = 1e-3 if is_better else 2e-3
        return Point(
            "", structure, fine.delay_ms, rms_m, 0.0, 0.0, 0.0, 0.0, 0.0, 1, {}, fine.q_kind
        )

    for name, function in {"bench_for": bench_of, "find": find, "point_of": point_of}.items():
        monkeypatch.setattr(points, name, function)
    found = designed_points(quick([160.0, 250.0], 30.0), "PD + DOB")
    assert [(each.delay_ms, each.q_kind) for each in found] == [
        (250.0, "order_2"),
        (160.0, "type_2"),
    ]
    first = [("type_2", None), ("order_2", None)]
    assert begun == [*first, ("type_2", {"k_p": 250.0}), ("order_2", {"k_p": 251.0})]


def test_the_predictor_is_searched_under_the_demands_of_the_others() -> None:
    panel = quick([160.0], 12.0, "predictor_generations=1", "search.starts=1")
    (found,) = predictor_points(panel)
    assert found.judged > 10
    assert found.noise_gain_rad_m <= 3.2
    assert found.peak_sensitivity <= 2.9
    assert found.rms_m < found.noisy_rms_m < 0.02


def test_the_table_and_the_picture_have_each_structure_and_delay(tmp_path: Path) -> None:
    lost = point("PD + map")._replace(delay_ms=500.0, rms_m=math.inf)
    found = [point("PD + map"), lost]
    write_csv(found, tmp_path / "frontier.csv")
    with (tmp_path / "frontier.csv").open() as file:
        line, _ = csv.DictReader(file)
    assert (line["structure"], line["delay_ms"]) == ("PD + map", "250")
    assert line["values"] == "k_p=1.48 k_d=0.0528 derivative_filter=35.2"
    figure = draw_frontier([whole()], found)
    assert not alike_without_colour(figure)
    drawn = [list(curve.get_xdata()) for curve in figure.axes[0].lines]
    assert [each for each in drawn if each] == [[250.0], [500.0]]


def test_the_panels_at_speed_are_of_the_vehicle_at_that_speed() -> None:
    _, at_60, at_100 = panels_of(asked(), vehicle())
    for panel, km_h in ((at_60, 60.0), (at_100, 100.0)):
        assert 3.6 * panel.vehicle.vehicle.speed_m_s == pytest.approx(km_h, rel=0.01)
        assert {corner.speed_m_s for corner in panel.vehicle.corners} == {
            *(panel.table.speed_m_s or ())
        }


def test_delays_must_ascend() -> None:
    table = whole().table.model_dump()
    with pytest.raises(SettingsError, match="delays_ms must be above 0 and ascend"):
        PanelTable(**{**table, "delays_ms": [250, 160]})
