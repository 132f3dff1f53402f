"""Figures and verdicts on signals whose answer is known, and against the linear theory."""

import math

import numpy as np
import pytest

from steer_by_wire.closed_loop.studies.compiled_figures import Figures, figures_of, latency_figures
from steer_by_wire.plant_emulator.evaluation.run_verdict import RunEnd, Verdict, VerdictRules
from tests.support.runs.study_signals import (
    NO_COMMANDS,
    RULES,
    TIME_S,
    figures,
    noise,
    sine,
    verdict,
)


@pytest.mark.parametrize("omega_rad_s", [0.9, 2.0, 5.0])
def test_an_oscillation_is_measured(omega_rad_s: float) -> None:
    found = figures(0.3 + 0.002 * TIME_S + sine(0.2, omega_rad_s))
    assert found.amplitude_m == pytest.approx(0.2, rel=0.06)
    assert found.oscillation_rad_s == pytest.approx(omega_rad_s, rel=0.05)
    # Two periods tilt the line they are fitted by; noise is beyond the rule's 0.4.
    assert found.irregularity < 0.5 * VerdictRules().irregularity
    assert not figures(noise(0.2)).irregularity <= VerdictRules().irregularity
    assert found.drift_m_s == pytest.approx(0.002, abs=2e-3)
    assert verdict(found) is Verdict.LIMIT_CYCLE


def test_figures_of_the_whole_run() -> None:
    error_m = np.concatenate((np.full(1000, 0.5), np.full(5001, -0.05)))
    found = figures(error_m)
    assert found.rms_m == pytest.approx(math.sqrt((1000 * 0.25 + 5001 * 0.0025) / 6001))
    assert (found.peak_m, found.final_m, found.settling_s) == (0.5, -0.05, 10.0)
    assert found.mean_m == pytest.approx(-0.05)
    assert found.mean_before_m == pytest.approx(-0.05)
    assert found.amplitude_m == pytest.approx(0.0, abs=1e-12)
    assert math.isnan(found.oscillation_rad_s)
    assert figures(np.zeros(6001)).settling_s == 0.0
    assert math.isnan(figures(np.full(6001, 0.2)).settling_s)


def test_the_effort_and_the_limits_of_the_commands() -> None:
    sent_rad = np.array([0.01, 0.02, 0.02, 0.04, 0.06, 0.06, 0.05, 0.6, 0.6, -0.6])
    found = figures(np.zeros(6001), sent_rad)
    steps = np.diff(sent_rad, prepend=0.0)
    assert found.steer_rms_rad == pytest.approx(np.sqrt(np.mean(sent_rad**2)))
    assert found.steer_peak_rad == 0.6
    assert found.steer_rate_rms_rad_s == pytest.approx(np.sqrt(np.mean(steps**2)) / 0.01)
    # Two steps of 0.02 rad, three commands at 0.6 rad, of which one came by a longer step.
    assert found.limited_share == pytest.approx(5 / 10)


def test_the_latency_that_99_percent_keep_to() -> None:
    latency_s = np.concatenate((np.full(100, np.nan), np.arange(1, 1001) * 1e-3))
    found = latency_figures(np.random.default_rng(1).permutation(latency_s))
    assert found.latency_mean_s == pytest.approx(0.5005)
    assert found.latency_p99_s == 0.99
    assert all(map(math.isnan, latency_figures(np.full(3, np.nan))))


def test_what_holds() -> None:
    assert verdict(figures(noise(0.003))) is Verdict.HOLDS
    # Noise is no oscillation, as long as it does not swing the vehicle.
    assert verdict(figures(noise(0.05))) is Verdict.HOLDS
    assert verdict(figures(sine(0.3, 2.0, -0.05))) is Verdict.HOLDS
    assert verdict(figures(sine(0.5, 2.0, -0.05))) is Verdict.LEFT_PATH
    # A steady error of PD under a lasting disturbance.
    assert verdict(figures(np.full(6001, 0.18))) is Verdict.HOLDS
    # A curve that the law follows with an error of 5 cm.
    assert verdict(figures(0.05 * np.cos(0.08 * TIME_S))) is Verdict.HOLDS


def test_an_oscillation_below_the_threshold_is_none() -> None:
    assert verdict(figures(sine(0.019, 2.0))) is Verdict.HOLDS
    assert verdict(figures(sine(0.021, 2.0))) is Verdict.LIMIT_CYCLE


def test_growth_is_distinguished_from_a_lasting_oscillation() -> None:
    growth_1_s = math.log(1.5) / 15.0
    assert verdict(figures(sine(0.05, 2.0, 1.2 * growth_1_s))) is Verdict.UNSTABLE
    assert verdict(figures(sine(0.05, 2.0, 0.8 * growth_1_s))) is Verdict.LIMIT_CYCLE
    decay_1_s = math.log(0.8) / 15.0
    assert verdict(figures(sine(0.5, 2.0, 0.8 * decay_1_s))) is Verdict.LIMIT_CYCLE
    assert verdict(figures(sine(0.2, 2.0, 1.2 * decay_1_s))) is Verdict.HOLDS
    assert verdict(figures(sine(0.5, 2.0, 1.2 * decay_1_s))) is Verdict.DECAYS


def test_a_drift_moves_away_and_is_far() -> None:
    assert verdict(figures(0.01 * TIME_S)) is Verdict.DRIFTS
    assert verdict(figures(-0.01 * TIME_S)) is Verdict.DRIFTS
    assert verdict(figures(0.004 * TIME_S)) is Verdict.HOLDS
    assert verdict(figures(1.0 - 0.01 * TIME_S)) is Verdict.DECAYS
    assert verdict(figures(-0.4 + 0.01 * TIME_S)) is Verdict.LEFT_PATH
    assert verdict(figures(-0.29 + 0.01 * TIME_S)) is Verdict.OFF_PATH
    assert verdict(figures(-0.29 + 0.008 * TIME_S)) is Verdict.HOLDS


def test_a_disturbance_at_the_end_is_no_oscillation() -> None:
    struck = np.where(TIME_S > 50.0, np.exp(-(TIME_S - 50.0)), 0.0)
    assert verdict(figures(0.24 * struck)) is Verdict.HOLDS
    assert verdict(figures(0.26 * struck)) is Verdict.OFF_PATH
    assert verdict(figures(1.0 * struck)) is Verdict.OFF_PATH


def test_how_a_run_ended_comes_first() -> None:
    found = figures(sine(0.3, 2.0))
    assert verdict(found, RunEnd.LEFT_RANGE) is Verdict.LEFT_RANGE
    assert verdict(found, RunEnd.CONTROLLER_FAILED) is Verdict.UNSTABLE
    nothing = Figures(*[math.nan] * len(Figures._fields))
    assert verdict(nothing, RunEnd.NO_START) is Verdict.NO_START
    # A run without figures does not hold.
    assert verdict(nothing) is Verdict.OFF_PATH


def test_a_run_too_short_for_two_windows_has_no_figures_of_its_end() -> None:
    cg_m, error_m = np.tile([3.0, -4.0], 50), np.ones(100)
    found = figures_of(*RULES, TIME_S[:100], error_m, cg_m, cg_m, np.zeros(100), NO_COMMANDS)
    assert found.rms_m == pytest.approx(math.sqrt(12.5))
    assert (found.peak_m, found.final_m, found.preview_rms_m) == (4.0, -4.0, 1.0)
    assert math.isnan(found.mean_m)
    assert math.isnan(found.amplitude_m)
    assert found.end_peak_m == 4.0
    assert verdict(found) is Verdict.LEFT_ROAD
    assert all(map(math.isnan, figures(np.zeros(0))[:-2]))
