"""The verdict by a log's measured errors against the plant's, which is by the true ones."""

import numpy as np
import pytest

from steer_by_wire.closed_loop.recordings.held_path import HeldPath
from steer_by_wire.dbc.messages import (
    LateralError,
    Mode,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
)
from steer_by_wire.plant_emulator.evaluation.run_verdict import (
    NOISE_GAIN,
    Peaks,
    RunEnd,
    VerdictRules,
    judge,
)

PERIOD_S = 0.01
TIME_S = PERIOD_S * np.arange(1500)
RULES = VerdictRules()


@pytest.mark.parametrize("seed", range(12))
def test_the_noise_of_the_sensor_is_told_from_the_oscillation_of_the_wheel(seed: int) -> None:
    draws = np.random.default_rng(seed)
    noise_m = draws.uniform(0.005, 0.04)
    swing = (
        NOISE_GAIN * noise_m * (draws.uniform(0.3, 0.85) if seed % 2 else draws.uniform(1.2, 2.0))
    )
    wheel_rad = swing * np.sin(draws.uniform(12.0, 30.0) * TIME_S)
    true_m = draws.uniform(0.0, 0.2) * np.cos(draws.uniform(0.05, 0.2) * TIME_S)
    held = HeldPath(RULES)
    held.take(SteeringCommand(0.0, 0, Mode.ACTIVE), 0.0, 0.0)
    for at_s, error_m, angle_rad in zip(TIME_S, true_m, wheel_rad, strict=True):
        status = SteeringStatus(float(angle_rad), 0, SteeringStatusCode.APPLYING)
        held.take(status, float(at_s), 0.0)
        measured_m = float(error_m + noise_m * draws.standard_normal())
        held.take(LateralError(measured_m, 0.0), float(at_s), 0.0)
    by_log = held.report(PERIOD_S, left_range=False)
    peaks_m = Peaks(float(np.abs(true_m).max()), float(np.abs(true_m[500:]).max()))
    true = judge(RULES, true_m, wheel_rad, RunEnd.COMPLETE, noise_m, peaks_m, PERIOD_S, len(TIME_S))
    assert by_log["verdict"] == true.verdict
    assert by_log["sensor_noise_m"] == pytest.approx(noise_m, rel=0.15)  # three standard errors
