"""Settings on the page, and hints about distributions."""

import pytest

from steer_by_wire.closed_loop.reports.page import page
from steer_by_wire.closed_loop.studies.result_files import Store
from steer_by_wire.closed_loop.studies.result_reader import Rows, StudyRecord, read_rows, read_study
from steer_by_wire.closed_loop.studies.run_study import run_missing
from steer_by_wire.closed_loop.studies.workers import thread_workers
from steer_by_wire.tools.study.report import study_section
from tests.support.runs.small_study import make_scenarios, never

STUDY = """
name = "levels"
[base]
plant_preset = "paper_nominal"
controllers = ["practical_pd", "practical_pd_dob"]
[base.plant]
duration_s = 4.0
path = "practical_ellipse"
latency = { downlink = { model = "gamma" } }
[[factors]]
name = "noise"
key = "plant.sensor_noise.lateral_error_m"
values = [0.0, 0.02]
[[factors]]
name = "filter"
key = "controller.pd.derivative_filter_rad_s"
values = [20.0, 40.0]
[[factors]]
key = "plant.latency.downlink.mean_s"
values = [0.05, 0.1]
[[factors]]
name = "jitter"
key = "plant.latency.downlink.spread_fraction"
values = [0.3]
[sampling]
replicates = 2
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> StudyRecord:
    folder = tmp_path_factory.mktemp("levels")
    scenarios = make_scenarios(folder, STUDY)
    store = Store(folder / "out", scenarios)
    store.open(STUDY)
    assert run_missing(store, thread_workers(scenarios, 1), lambda _: None, never)
    return read_study(store.folder)


@pytest.fixture(scope="module")
def rows(study: StudyRecord) -> Rows:
    return read_rows(study)


def test_the_page_folds_what_is_by_default(study: StudyRecord, rows: Rows) -> None:
    text = page("levels", [study_section(study, rows)])
    shown = text.partition("Base of the plant")[2].partition("<details>")[0]
    assert "duration_s = 4.0" in shown
    assert "yaw_inertia" not in shown
    assert "yaw_inertia" in text.partition("Base of the plant")[2].partition("</details>")[0]
    assert "Warning: runs of 4 s are judged by two windows of 1 s" in text
