"""The figures to which each example comes, from what its ``main`` returns."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest


def rms_mm(run: Any) -> float:
    return 1e3 * float(run.settled_rms_m)


def check_first_loop(run: Any) -> None:
    assert 6.0 < rms_mm(run) < 9.0
    late = run.plant.time_s > 18.0
    assert np.max(np.abs(run.plant.cg_deviation_m[late])) < 0.01


def check_own_network(runs: Any) -> None:
    assert 30.0 < rms_mm(runs["practical_pd"]) < 50.0
    assert 2.0 < rms_mm(runs["practical_pd_ddob"]) < 8.0
    assert 0.1 < rms_mm(runs["practical_predictor"]) < 1.0
    latency_s = runs["practical_pd"].plant.downlink_latency_s
    assert 0.02 < np.nanmedian(latency_s[:2500]) < 0.04
    assert 0.06 < np.nanmedian(latency_s[3000:]) < 0.09


def check_car_from_a_log(intervals: Any) -> None:
    low, high = intervals["understeer_gradient_rad_s2_m"]
    assert low <= (1.491 / 145_700 - 1.45 / 239_500) * 2010.5 / 2.941 <= high
    without_m, late_m = intervals["peaks_m"]
    assert 0.03 < without_m < late_m < 0.2


def check_two_studies(tables: Any) -> None:
    worst = {
        order: np.max(table["settled_rms_m"][table["controller"] == "practical_pd_ddob"])
        for order, table in tables.items()
    }
    assert 0.002 < worst["newest_wins"] < 0.01
    assert 0.2 < worst["in_order"] < 2.0


def check_own_path(run: Any) -> None:
    assert np.max(run.plant.curvature_1_m) == pytest.approx(0.05, rel=0.02)
    assert 35.0 < rms_mm(run) < 45.0


def check_own_car(runs: Any) -> None:
    spins, holds = runs.values()
    assert "the car has left its path" in spins.outcome
    assert holds.outcome == "complete"
    assert 1.7 < holds.peak_m < 1.9
    assert np.max(np.abs(holds.plant.yaw_rate_rad_s)) < 0.25


def check_own_disturbance(runs: Any) -> None:
    pd, ddob = (rms_mm(run) for run in runs.values())
    assert 0.4 < ddob < pd < 1.5


def check_felt_delay(grown: Any) -> None:
    for farther_in, inside, _, outside in grown.values():
        assert farther_in < inside < 0.8
        assert outside > 5.0


def check_own_law(runs: Any) -> None:
    pd_mm, own_mm = (1e3 * run.preview_rms_m for run in runs.values())
    assert 28.0 < pd_mm < 35.0
    assert 9.0 < own_mm < 13.0


def check_networked_prediction(runs: Any) -> None:
    ours_m, published_m = (run.preview_peak_m for run in runs.values())
    assert 0.008 < ours_m < 0.04
    assert 0.07 < published_m < 0.15


def check_packetised_mpc(runs: Any) -> None:
    lq, mpc = runs.values()
    assert lq.preview_peak_m > 1.0
    assert 0.3 < mpc.preview_peak_m < 0.7
    # The limit is reached, and kept where a plan follows another.
    for run in (lq, mpc):
        wheel_rad_s = np.max(np.abs(np.diff(run.plant.wheel_angle_rad))) / 0.01
        assert wheel_rad_s == pytest.approx(0.03, rel=1e-3)


CHECKS: dict[str, Callable[[Any], None]] = {
    "first_loop": check_first_loop,
    "own_car_from_a_log": check_car_from_a_log,
    "own_network_from_a_log": check_own_network,
    "two_studies_compared": check_two_studies,
    "own_path": check_own_path,
    "own_car": check_own_car,
    "own_disturbance": check_own_disturbance,
    "felt_delay": check_felt_delay,
    "own_law": check_own_law,
    "networked_prediction": check_networked_prediction,
    "packetised_mpc": check_packetised_mpc,
}
