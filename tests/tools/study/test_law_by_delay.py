"""Laws over the mean delay: the shipped comparison in small, its tables, and where a law breaks."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from steer_by_wire import run_study
from steer_by_wire.closed_loop.studies.result_files import Store
from steer_by_wire.closed_loop.studies.result_reader import Rows, read_results
from steer_by_wire.closed_loop.studies.run_study import run_missing
from steer_by_wire.closed_loop.studies.scenario import Scenarios
from steer_by_wire.closed_loop.studies.study import Study, make_study
from steer_by_wire.closed_loop.studies.study_file import StudySettings, read_study
from steer_by_wire.closed_loop.studies.workers import thread_workers
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.study.law_by_delay import (
    LawByDelay,
    draw_error_over_delay,
    law_by_delay,
    law_section,
)
from tests.support.runs.small_study import complete, make_scenarios, never, stored_row
from tests.support.runs.stored_pair import pair_of_row

SHIPPED = Path(__file__).parents[3] / "closed_loop" / "studies"


def cut(
    settings: StudySettings, laws: tuple[str, ...], **factors: tuple[Any, ...]
) -> StudySettings:
    """Return a study with some of its laws, one seed, runs of 20 s, and these values of factors."""
    plant = settings.base.plant | {"duration_s": 20.0}
    variants = {name: settings.base.variants[name] for name in laws}
    changed = []
    for factor in settings.factors:
        name = factor.name or (factor.key or "").rpartition(".")[2]
        if name not in factors:
            changed.append(factor)
        elif factor.levels is not None:
            levels = {label: factor.levels[label] for label in factors[name]}
            changed.append(factor.model_copy(update={"levels": levels}))
        else:
            ranged = {"start": None, "stop": None, "step": None, "values": factors[name]}
            changed.append(factor.model_copy(update=ranged))
    return settings.model_copy(
        update={
            "base": settings.base.model_copy(update={"plant": plant, "variants": variants}),
            "factors": tuple(changed),
            "sampling": settings.sampling.model_copy(update={"replicates": 1}),
        }
    )


def computed(folder: Path, settings: StudySettings) -> tuple[Study, Rows]:
    scenarios = Scenarios(make_study(settings, "study.toml", folder))
    store = Store(folder / "out", scenarios)
    store.open("")
    assert run_missing(store, thread_workers(scenarios, 2), lambda _: None, never)
    return read_results(store.folder)


def by_delay(study: Study, rows: Rows) -> LawByDelay:
    found = law_by_delay(study, rows)
    assert found is not None
    return found


def test_the_predictor_holds_half_a_second_and_the_observers_do_not(tmp_path: Path) -> None:
    laws = ("PD+DDOB", "predictor", "PID, preview point")
    compare = cut(read_study(SHIPPED / "compare.toml"), laws, mean_s=(0.0, 0.5))
    found = by_delay(*computed(tmp_path, compare))
    assert (found.controllers, found.delays_ms) == (laws, (0.0, 500.0))
    constant, newest_wins, in_order, lost, lag = range(5)
    assert found.conditions[constant] == "constant delay"
    assert found.conditions[lag] == "actuator lag 0.27 s"
    ddob, predictor, of_preview = range(3)
    for condition in (constant, newest_wins, in_order, lost):
        assert found.settled_m[condition, predictor, 1] < 0.003
    assert found.settled_m[constant, ddob, 1] > 0.1
    assert found.settled_m[constant, of_preview, 0] > 0.05
    assert found.settled_m[lag, predictor, 1] < 0.03
    # Newest wins, what acts is younger than the mean, and hides what jitter does in order: the car
    # is as near to the path as without latency.
    assert found.settled_m[newest_wins, ddob, 1] < found.settled_m[newest_wins, ddob, 0] < 0.015
    assert found.settled_m[in_order, ddob, 1] > 0.1
    broken = [found.breaks_at_ms(condition, ddob) for condition in range(5)]
    assert broken == [500.0, None, 500.0, 500.0, 500.0]
    assert found.breaks_at_ms(constant, predictor) is None

    section = law_section(found, ())
    breaks, rms, *_ = section.tables
    assert [cell.text for cell in breaks.rows[ddob]] == ["PD+DDOB", "500", "-", "500", "500", "500"]
    assert rms.rows[ddob][-1].text == "-"
    assert len(section.tables) == 1 + len(found.conditions)
    law = {"PD+DDOB": "pd_ddob", "predictor": "predictor"}
    (legend,) = draw_error_over_delay(found, ("predictor", "PD+DDOB"), law).legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "predictor: holds throughout",
        "PD+DDOB: breaks at 500 ms",
    ]


def test_a_published_law_breaks_at_80_ms_where_it_has_its_own_rate(tmp_path: Path) -> None:
    compare = read_study(SHIPPED / "compare.toml")
    laws = ("PD as published", "PD+DDOB")
    chosen = cut(compare, laws, mean_s=(0.0, 0.08), network=("constant delay",))
    found = by_delay(*computed(tmp_path, chosen))
    assert [found.breaks_at_ms(0, law) for law in range(2)] == [80.0, None]


def test_it_breaks_where_the_lane_is_lost_first_and_nominal_differs_from_heavy(
    tmp_path: Path,
) -> None:
    at_speed = read_study(SHIPPED / "compare_at_speed.toml")
    networks = ("25 % lost in bursts of 15", "25 % lost in bursts of 15, 5000 kg")
    chosen = cut(at_speed, ("predictor",), mean_s=(0.1,), network=networks)
    seeded = chosen.sampling.model_copy(update={"seed": 1001})  # whatever the study's is
    found = by_delay(*computed(tmp_path, chosen.model_copy(update={"sampling": seeded})))
    nominal, heavy = found.peak_m[:, 0, 0].tolist()
    assert 1e-4 < 1.1 * nominal < heavy < 0.1
    assert found.holds.all()


def test_a_law_breaks_at_the_first_delay_at_which_any_run_does_not_hold(tmp_path: Path) -> None:
    compare = read_study(SHIPPED / "compare.toml")
    chosen = cut(compare, ("PD",), mean_s=(0.0, 0.05, 0.1), network=("constant delay",))
    study, rows = computed(tmp_path, chosen)
    verdict = rows["verdict"].copy()
    at = np.flatnonzero((rows["mean_s"] == 0.05) & (rows["corner"] == "c"))
    verdict[at] = "off path"
    assert by_delay(study, rows).breaks_at_ms(0, 0) is None
    assert by_delay(study, {**rows, "verdict": verdict}).breaks_at_ms(0, 0) == 50.0


def test_inside_the_box_the_predictor_holds_the_car_itself_on_the_path(tmp_path: Path) -> None:
    file = tmp_path / "interior.toml"
    file.write_text(
        """
[base]
plant_preset = "paper_nominal"
variants.car = { preset = "practical_predictor" }
plant = { duration_s = 60.0, path = "practical_ellipse", safety.ftti_ms = "off" }
[[factors]]
key = "plant.vehicle.speed_m_s"
start = 1.1111111111111112
stop = 1.9444444444444444
[[factors]]
key = "plant.vehicle.virtual_mass_kg"
start = 1600.0
stop = 5000.0
[[factors]]
key = "plant.latency.downlink.mean_s"
start = 0.0
stop = 0.5
[sampling]
kind = "sobol"
count = 16
""",
        encoding="utf-8",
    )
    table = run_study(file)
    assert {delay_s > 0.25 for delay_s in table["mean_s"].tolist()} == {True, False}
    assert 1e-5 < table["settled_rms_m"].min() <= table["settled_rms_m"].max() < 8e-3


# Variants of a controller

VARIANTS = """
name = "variants"
[base]
plant_preset = "paper_nominal"
controllers = ["practical_pd"]
plant.duration_s = 2.0
[base.variants]
quick = { preset = "practical_pd", controller.rate_hz = 200.0, plant.sensor_period_ms = 5.0 }
map = { preset = "practical_pd", controller.feed_forward = {} }
[[factors]]
key = "plant.latency.downlink.mean_s"
values = [0.0, 0.1]
"""


def test_a_variant_has_settings_of_its_own_and_changes_the_plant_of_its_runs_alone(
    tmp_path: Path,
) -> None:
    scenarios = make_scenarios(tmp_path, VARIANTS)
    scenarios.check()
    assert scenarios.controllers == ("practical_pd", "quick", "map")
    plain, quick, with_map = (scenarios.pair(run) for run in (3, 4, 5))
    assert (quick.controller.rate_hz, quick.plant.sensor_period_ms) == (200.0, 5.0)
    assert (plain.controller.rate_hz, plain.plant.sensor_period_ms) == (100.0, 10.0)
    assert with_map.controller.feed_forward is not None
    assert quick.plant.latency.downlink.mean_s == 0.1
    store = complete(tmp_path, text=VARIANTS)
    table = run_study(tmp_path / "study.toml")
    assert table["samples"].tolist() == [200.0, 400.0, 200.0] * 2
    for run, pair in ((3, plain), (4, quick), (5, with_map)):
        row = stored_row(store, run)
        assert row is not None
        assert pair_of_row(json.loads(scenarios.study.record), row) == pair


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("map = {", "practical_pd = {", "must differ from each other in their names"),
        ('quick = { preset = "practical_pd"', 'quick = { preset = "nosuch"', "preset 'nosuch'"),
        ("controller.rate_hz = 200.0", "controller.rate = 200.0", r"base\.variants\.quick: rate "),
        ("plant.sensor_period_ms = 5.0", "plant.sensor_period = 5.0", "sensor_period"),
    ],
)
def test_a_mistake_in_a_variant_is_refused_in_one_line(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(SettingsError, match=message) as caught:
        make_scenarios(tmp_path, VARIANTS.replace(old, new)).check()
    assert len(caught.value.mistakes) == 1


def test_a_report_of_a_controller_that_is_not_there_is_refused(tmp_path: Path) -> None:
    text = VARIANTS + '[report]\nerror_over_delay = ["slow"]\n'
    with pytest.raises(SettingsError, match="'slow' is none of the controllers"):
        make_scenarios(tmp_path, text)
