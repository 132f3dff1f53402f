"""The frontier of feedback laws: its figures by runs, and those that the page names."""

import json
from math import inf
from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop.pair.pair_result import rms
from steer_by_wire.closed_loop.scripting.feedback import unstable_round_trips
from steer_by_wire.hand_wheel.analysis.nominal_road import Rack, RoadVehicle
from steer_by_wire.hand_wheel.analysis.sampled_laws import PASS_THROUGH, sampled_cdob, sampled_dob
from steer_by_wire.hand_wheel.wheel import WheelSettings
from steer_by_wire.tools.feedback import __main__ as program
from steer_by_wire.tools.feedback import frontier, frontier_runs
from steer_by_wire.tools.feedback.frontier import BAND_RAD_S, Bench, Design, responses
from steer_by_wire.tools.feedback.frontier_runs import Column, changed_in_runs, settle

SEDAN = RoadVehicle(80 / 3.6, 1750.0, 2900.0, 110e3, 150e3, 1.25, 1.55)
CYCLE_S = 0.005
BENCH = Bench(SEDAN, 6.0, Rack(), WheelSettings(), CYCLE_S, 0.05)
LAWS = {
    "damping": PASS_THROUGH.with_damping(0.4, CYCLE_S, 300.0),
    "cdob": sampled_cdob(BENCH.road(), CYCLE_S),
    "dob": sampled_dob(0.035, 0.5, CYCLE_S, 40.0),
}


@pytest.mark.parametrize("law", LAWS)
def test_a_run_settles_where_the_exact_loop_is_stable(law: str) -> None:
    design = Design(law, LAWS[law])
    first_s = unstable_round_trips(BENCH.loop(design, 1.0), 3.0)[0].start_s
    columns = [Column(design, 1.0, factor * first_s) for factor in (0.8, 1.2)]
    assert settle(BENCH, columns) == [True, False]


def test_a_dob_gives_the_wheel_the_damping_it_is_told() -> None:
    inertia, damping, omegas = 0.035, 0.5, np.array([0.5, 2.0])
    s = 1j * omegas
    by_angle, by_road, by_driver = responses(
        sampled_dob(inertia, damping, 1e-3, 200.0), omegas, 1e-3
    )
    own = s * (WheelSettings().inertia_kg_m2 * s + WheelSettings().damping_n_m_s)
    felt = (by_angle + by_driver * own) / (1.0 - by_driver) + own
    assert felt == pytest.approx(s * (inertia * s + damping), rel=0.02)
    assert by_road / (1.0 - by_driver) == pytest.approx(np.ones(2), abs=0.01)


def test_the_change_of_the_felt_torque_is_that_of_a_run() -> None:
    for name in ("damping", "cdob"):
        law, at_s = LAWS[name], 0.05
        by_angle, by_road, _ = responses(law, BAND_RAD_S, CYCLE_S)
        ideal = frontier.road_response(BENCH, 1.0)
        felt = by_angle + by_road * ideal * np.exp(-1j * BAND_RAD_S * at_s)
        exact = rms(felt - ideal) / rms(ideal)
        assert changed_in_runs(BENCH, [Column(Design("", law), 1.0, at_s)])[0] == pytest.approx(
            exact, rel=0.1
        )


def test_noise_filters_the_rate_of_a_stronger_damping_more() -> None:
    designs = list(frontier.damped(BENCH, PASS_THROUGH, "", [0.1, 0.5, 2.0]))
    cutoffs = [float(each.settings.split("(")[1].split()[0]) for each in designs]
    assert cutoffs[0] >= cutoffs[1] > cutoffs[2]


def test_a_passivity_controller_stills_what_shakes_without_it() -> None:
    design = list(frontier.passivity_controllers(BENCH))[-1]
    loop = [Column(each, 1.0, 0.1) for each in (design, design._replace(passive_n_m_s=(inf, 0.0)))]
    assert settle(BENCH, loop) == [True, False]


def test_the_command_writes_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (frontier, frontier_runs, program):
        monkeypatch.setattr(module, "ROUND_TRIPS_S", (0.02, 0.1))
    monkeypatch.setattr(frontier, "_CUTOFFS_RAD_S", (10.0, 20.0))
    monkeypatch.setattr(frontier, "_WASHOUTS_RAD_S", (4.0, 8.0))
    monkeypatch.setattr(frontier, "_DAMPINGS_N_M_S", frontier._DAMPINGS_N_M_S[::3])
    monkeypatch.setattr(frontier, "_CDOB_DAMPINGS_N_M_S", (0.0, 0.1))
    assert program.main(["--cycle-ms", "5", "--frontier", str(tmp_path / "new")]) == 0
    assert (tmp_path / "new" / "frontier.png").read_bytes().startswith(b"\x89PNG")
    points = json.loads((tmp_path / "new" / "frontier.json").read_text())["points"]
    changed = {(point["law"], point["round_trip_s"]): point["changed"] for point in points}
    late = {(point["law"], point["round_trip_s"]): point["late_s"] for point in points}
    arrives, controller = "force as it arrives, damped", "passivity controller"
    assert changed[arrives, 0.02] < 0.5
    assert changed["CDOB", 0.1] < changed[controller, 0.1] < changed[arrives, 0.1]
    assert late[arrives, 0.1] == late[controller, 0.1] == pytest.approx(0.05)
    assert 0.2 < late["CDOB", 0.1] < 0.6
    assert changed["spring", 0.02] > 1.0
