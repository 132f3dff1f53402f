"""Runs of the paper from both sides, and against views of them that share no code."""

import math

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, trapezoid
from scipy.special import ellipe

from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.filters.nominal_model import paper_eq19, steer_to_lateral_error
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.path.path import curvature
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.tools.paper import published
from steer_by_wire.tools.paper.corners import preset_vehicle
from steer_by_wire.tools.paper.delay_runs import (
    CDOB,
    DDOB,
    FILTER,
    PD,
    TYPE_2,
    WASHOUT,
    Law,
    delayed_plant,
    drive,
    peak,
)
from steer_by_wire.tools.paper.simulation import PAPER_DELAY_S, History
from steer_by_wire.tools.paper.table_2 import CORRECTED, FITTED_CUTOFF_RAD_S, PRINTED, simulated_row

PD_ROW_M = tuple(column.pd_m for column in published.TABLE_2)
PD_DOB_ROW_M = tuple(column.pd_dob_m for column in published.TABLE_2)


def test_the_pd_row_comes_out_with_the_zero_restored() -> None:
    assert simulated_row("", "paper_pd", CORRECTED).rms_m == pytest.approx(PD_ROW_M, abs=2e-4)


def test_the_printed_stiffness_gives_the_mass_trend_the_wrong_sign() -> None:
    row = simulated_row("", "paper_pd", PRINTED)
    light_slow, heavy_slow, light_fast, heavy_fast = row.rms_m
    assert -0.001 < heavy_slow - light_slow < -0.0003
    assert -0.002 < heavy_fast - light_fast < -0.001


def test_the_pd_dob_row_comes_out_within_six_percent_with_a_cutoff_of_its_own_alone() -> None:
    row_m = simulated_row("", "paper_pd_dob", CORRECTED).rms_m
    assert row_m == pytest.approx((0.00135, 0.00135, 0.00176, 0.00178), abs=3e-5)
    cutoff = f"dob.q_cutoff_rad_s={FITTED_CUTOFF_RAD_S}"
    row_m = simulated_row("", "paper_pd_dob", CORRECTED, cutoff).rms_m
    assert row_m == pytest.approx((0.0338, 0.0339, 0.0357, 0.0360), abs=5e-5)
    assert row_m == pytest.approx(PD_DOB_ROW_M, rel=0.06)


def mean_before(run: History, time_s: float) -> float:
    window = (run.time_s > time_s - 5.0) & (run.time_s <= time_s)
    return float(np.mean(run.lateral_error_m[window]))


def is_stable_at_the_papers_delay(law: Law, filter_rad_s: float) -> bool:
    overrides = (*law.overrides, f"pd.derivative_filter_rad_s={filter_rad_s}")
    controller = controller_preset(law.preset, overrides)
    model = steer_to_lateral_error(preset_vehicle("paper_nominal"))
    loop = SampledLoop(design_law(controller), model, controller.period_ns)
    return loop.is_stable(round(PAPER_DELAY_S * NS_PER_S))


@pytest.mark.parametrize(("law", "last_rad_s"), [(PD, 17.8), (CDOB.changed(*WASHOUT), 54.0)])
def test_each_law_survives_the_papers_delay_up_to_the_filter_that_the_page_states(
    law: Law, last_rad_s: float
) -> None:
    assert is_stable_at_the_papers_delay(law, 0.99 * last_rad_s)
    assert not is_stable_at_the_papers_delay(law, 1.01 * last_rad_s)


def gain_ratio_at_rest() -> float:
    """G/G_n at s = 0, the vehicle's over that of (19); both have two integrators."""
    _, (zeros,), (poles,), _ = steer_to_lateral_error(preset_vehicle("paper_nominal"))
    _, (nominal_zeros,), (nominal_poles,), _ = paper_eq19()
    return (zeros.s0 / poles.s0) / (nominal_zeros.s0 / nominal_poles.s0)


def test_cdob_as_published_hardly_steers_so_that_curvature_acts_twice_integrated() -> None:
    plant = delayed_plant(60.0)
    run = drive([CDOB.changed(*FILTER)], plant)[CDOB.label]
    speed_m_s = plant.vehicle.speed_m_s
    path = build_path(plant.path)
    time_s = np.linspace(0.0, 60.0, 1201)
    rho_1_m = np.array([curvature(path, speed_m_s * at_s) for at_s in time_s])
    heading_rad = cumulative_trapezoid(speed_m_s * rho_1_m, time_s, initial=0.0)
    unsteered_m = -trapezoid(speed_m_s * heading_rad, time_s)
    assert peak(run.wheel_angle_rad) < 1e-3
    assert run.lateral_error_m[-1] == pytest.approx(unsteered_m, rel=2e-3)


def test_ddob_as_published_drifts_and_with_washout_and_type_2_q_does_not() -> None:
    """Drift: (13) towards rest, G_n/G (1 - Q) = G_n/G 2s/ω_D, of (5), with the mean curvature."""
    a, b = 78.2, 41.74
    lap = 4.0 * a * float(ellipe(1.0 - (b / a) ** 2)) / (5.0 / 3.6)
    plant = delayed_plant(2.0 * lap)
    speed_m_s = plant.vehicle.speed_m_s
    mean_curvature_1_m = 2.0 * math.pi / (lap * speed_m_s)
    drift_m_s = -2.0 / 5.0 * speed_m_s**2 * mean_curvature_1_m / gain_ratio_at_rest()
    ends_m = {}
    for overrides in (FILTER, (*FILTER, *WASHOUT, *TYPE_2)):
        run = drive([DDOB.changed(*overrides)], plant)[DDOB.label]
        ends_m[overrides] = mean_before(run, lap), mean_before(run, 2.0 * lap)
    first_m, second_m = ends_m[FILTER]
    assert -6.0 < first_m < -5.0
    assert (second_m - first_m) / lap == pytest.approx(drift_m_s, rel=0.01)
    first_m, second_m = ends_m[(*FILTER, *WASHOUT, *TYPE_2)]
    assert abs(first_m) < 2e-4
    assert abs(second_m - first_m) < 1e-5
